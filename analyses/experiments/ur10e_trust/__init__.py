"""The experiment `ur10e-trust`."""
