"""The experiment `linear-path`."""
