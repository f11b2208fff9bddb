"""Experiments of `study`, one question a file. None imports another."""
