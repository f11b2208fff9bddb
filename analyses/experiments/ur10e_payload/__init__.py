"""The experiment `ur10e-payload`."""
