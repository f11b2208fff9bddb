"""The experiment `identification`."""
