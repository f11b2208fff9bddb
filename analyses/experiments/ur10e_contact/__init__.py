"""The experiment `ur10e-contact`."""
