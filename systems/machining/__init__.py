"""The process forces at the tool, and the reference of a machining pass."""
