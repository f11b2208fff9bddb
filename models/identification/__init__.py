"""From logs to a model of one robot."""
