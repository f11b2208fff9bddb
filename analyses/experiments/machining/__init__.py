"""The simulated arm at work on a surface."""
