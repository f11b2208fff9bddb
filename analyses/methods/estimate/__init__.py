"""The command `estimate`: a log and a model in, wrenches with their uncertainty out.

Order: estimate_config (settings), uniform_log (the log on a grid), first_pass (load, drift and
prior; friction_watch weighs them), engines (the estimator over the samples), log_readings (what is
kept of them: estimate_summary, contact_episodes, contact_places), estimate_data_set (LeRobot),
estimation (all of it).
"""
