"""Sub-package of the command `watch`: a live robot or a replayed log in, readings out.

Order: watch_config (settings); links and sources (the list), *_source, lcm_links, ros2_dds (one
protocol each); reader_process and ring (the process that reads); start_checks, stream_judgement and
load_search (warnings); session; recorder; publishers, ros2_publisher; live_display, arm_scene,
meshcat_view, foxglove_view; watching (the whole command); playing with rtde_controller and
ros2_player (a simulated arm that others read).
"""
