"""A model made fit for one robot and its load: from seconds of motion, or from a known weight."""
