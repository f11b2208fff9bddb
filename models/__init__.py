"""What is known about a robot, its task and its friction: data and pure mathematics."""
