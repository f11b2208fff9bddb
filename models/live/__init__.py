"""Live streams of a robot: samples, sources, wire formats, and what is read of each."""
