"""The experiment `contact-detection`."""
