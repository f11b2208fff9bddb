"""The experiment `realism`."""
