"""The simulated arm in free motion, untouched or pushed by hand."""
