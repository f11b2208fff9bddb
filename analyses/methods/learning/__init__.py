"""From logs to models: identification, friction, and what it takes to trust them."""
