"""Robots in contact beside a force sensor: their recordings, and how each is read."""
