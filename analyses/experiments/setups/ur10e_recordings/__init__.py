"""The UR10e's recordings, the force of its known payload, and simulated twins of its logs."""
