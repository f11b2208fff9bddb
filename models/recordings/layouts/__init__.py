"""Layouts of logs that other programs write, known by the names of their columns."""
