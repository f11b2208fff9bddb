"""Logs of robots: read, checked, resampled and written."""
