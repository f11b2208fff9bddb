"""The experiment `tx40-identification`."""
