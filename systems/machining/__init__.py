"""The process under the tool, and the way it is led along the work."""
