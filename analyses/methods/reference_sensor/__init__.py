"""Comparison with a force sensor: columns of a log in, the sensor's mounting and errors out.

Order of the files: reference_config (settings), sensor_log (reading and sensor side by side),
mounting (frame, sign, tare, delay), judged_force and force_errors (errors), comparison (by phase).
"""
