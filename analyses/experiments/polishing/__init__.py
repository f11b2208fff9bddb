"""The experiment `polishing`."""
