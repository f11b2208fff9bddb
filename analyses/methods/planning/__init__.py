"""Motions, places and postures chosen for a task."""
