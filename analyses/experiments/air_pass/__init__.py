"""The experiment `air-pass`."""
