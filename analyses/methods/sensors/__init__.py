"""Readings held against a force sensor: where it is mounted, and how far the two differ."""
