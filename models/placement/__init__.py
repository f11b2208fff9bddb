"""Choosing where a path lies."""
