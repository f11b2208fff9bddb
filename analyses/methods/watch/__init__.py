"""The command `watch`: a live robot or a replayed log in, wrenches to displays and publishers out.

Order: watch_config (settings), links and sources (rtde, ros2, franka, lcm, replay), reader_process
and ring (the process that reads), start_checks, session, recorder, publishers and views, watching
(all of it); playing (a simulated arm that others read).
"""
