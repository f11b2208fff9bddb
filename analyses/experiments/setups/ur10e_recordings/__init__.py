"""The UR10e's recordings, its known payload, its runs in contact, and twins of its logs."""
