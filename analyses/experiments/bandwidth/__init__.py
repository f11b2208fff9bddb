"""The experiment `bandwidth`."""
