"""The experiment `ur10e-identification`."""
