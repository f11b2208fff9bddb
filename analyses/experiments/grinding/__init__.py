"""The experiment `grinding`."""
