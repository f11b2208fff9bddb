"""The experiment `combined`."""
