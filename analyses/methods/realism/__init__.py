"""How like a real arm a simulated one is: the same motions, the same identification, statistics."""
