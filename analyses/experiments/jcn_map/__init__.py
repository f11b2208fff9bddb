"""The experiment `jcn-map`."""
