"""Sensors and filters."""
