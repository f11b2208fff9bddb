"""Recordings of a Panda's reported external torque: beside a sensor, and touched by a hand."""
