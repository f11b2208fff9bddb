"""LeRobot's data sets: read as logs, an episode each, and copied with a wrench."""
