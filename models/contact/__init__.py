"""The force of a tool on a workpiece, from what the contact itself leaves in the torques."""
