"""The experiment `lara8-contact`."""
