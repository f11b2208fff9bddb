"""Observers of external joint torque, and what their lag does to a reading."""
