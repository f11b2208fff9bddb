"""The experiment `friction`."""
