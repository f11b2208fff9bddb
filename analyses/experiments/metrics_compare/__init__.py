"""The experiment `metrics-compare`."""
