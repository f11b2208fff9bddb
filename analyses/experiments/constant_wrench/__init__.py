"""The experiment `constant-wrench`."""
