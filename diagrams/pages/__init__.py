"""Web pages of an arm in motion, made by a headless Meshcat."""
