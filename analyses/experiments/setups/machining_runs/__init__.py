"""The simulated arm at work on a plate or a blade, with and without a sensor, and read."""
