"""Where an arm may go: paths, surfaces, inverse kinematics, and measures of postures."""
