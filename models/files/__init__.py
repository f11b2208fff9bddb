"""Files, whatever they hold: written whole or not at all, and refused in one line."""
