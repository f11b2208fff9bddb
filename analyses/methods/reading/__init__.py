"""From logs to wrenches, and how far they are from a reference."""
