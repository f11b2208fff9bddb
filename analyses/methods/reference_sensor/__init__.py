"""Comparison of a reading with a force sensor: columns of a log in, mounting and errors out.

Order: reference_config (settings), sensor_log (the sensor's columns), mounting (its frame, sign and
delay), judged_force and force_errors (errors by phase), comparison (all of it).
"""
