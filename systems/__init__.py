"""Drake LeafSystems, one a file: a piece of `models` mathematics in ports, state and parameters."""
