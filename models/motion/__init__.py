"""Where an arm may go: paths, surfaces, inverse kinematics, and what a posture is worth."""
