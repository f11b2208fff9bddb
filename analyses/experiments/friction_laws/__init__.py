"""The experiment `friction-laws`."""
