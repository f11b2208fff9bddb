"""What a robot.yaml and its URDF say about one arm."""
