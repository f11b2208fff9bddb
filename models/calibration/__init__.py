"""A model adapted to one robot and its load: from seconds of motion, or from a known weight."""
