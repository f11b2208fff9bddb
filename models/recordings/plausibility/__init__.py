"""Whether what a log says can come from its robot: evidence gathered sample by sample."""
