"""Wrenches from the controller's external torque: logs in, wrenches and contacts out.

Order of the files: torque_log (one log), torque_touches (contacts and their places),
rows_beside_sensor and force_readings (errors against a sensor), torque_logs (the whole command).
"""
