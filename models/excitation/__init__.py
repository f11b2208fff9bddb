"""Choosing motions from which a robot's parameters show."""
