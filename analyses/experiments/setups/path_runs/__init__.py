"""The simulated arm along the article's paths, pushed or repeating itself, and read."""
