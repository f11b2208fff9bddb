"""Recordings of real robots."""
