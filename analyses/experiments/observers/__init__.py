"""The experiment `observers`."""
