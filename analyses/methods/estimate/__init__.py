"""Sub-package of the command `estimate`: a log and a model in, wrenches with their uncertainty out.

Order of the files: estimate_config (settings), model_checks, uniform_log (the log on its grid),
first_pass (load, drift, prior; friction_monitor weighs load against drift), engines (readings),
log_readings (judged and written; estimate_summary, contact_episodes, contact_places sum them up),
estimate_data_set (LeRobot), estimation (the whole pipeline).
"""
