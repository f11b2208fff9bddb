"""Wrenches from the controller's external torque: logs in, wrenches and contacts out.

Order: torque_log (one log), force_readings (wrenches by several methods), torque_touches (contacts
and links), rows_beside_sensor, torque_logs (the command `estimate` on such logs).
"""
