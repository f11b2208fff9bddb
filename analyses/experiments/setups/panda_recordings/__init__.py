"""Recordings of a Panda's own external torque: beside a sensor, and touched by a hand."""
