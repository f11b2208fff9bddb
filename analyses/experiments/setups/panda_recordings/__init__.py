"""Recordings of a Panda's reported external torque: beside a sensor, and touched by a hand.

In: the folder of recordings. Out: logs with the force of the sensor (`pose_logs`), and with the
link that was touched (`touch_logs`).
"""
