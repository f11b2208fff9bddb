"""Scenarios simulated and read."""
