"""What a run shows: files, figures, progress. Knows no robot."""
