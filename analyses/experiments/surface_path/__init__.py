"""The experiment `surface-path`."""
