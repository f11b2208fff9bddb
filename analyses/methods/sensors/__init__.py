"""Readings compared with a force sensor: how it is mounted, and how far the two differ."""
