"""The experiment `repeat-cycle`."""
