"""Room of the command `watch`: a live robot or a replayed log in, readings out.

Order of the files: watch_config (settings), links and sources (rtde, ros2, franka, lcm, replay),
reader_process and ring (the process that reads), start_checks and load_search, session, recorder,
publishers and views, watching (the whole command); playing (a simulated arm that others read).
"""
