"""What a posture does to the force that is read in it."""
