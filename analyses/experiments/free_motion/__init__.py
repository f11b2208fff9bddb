"""Arms in free motion, simulated and real, untouched or pushed by hand."""
