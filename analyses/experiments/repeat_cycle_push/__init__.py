"""The experiment `repeat-cycle-push`."""
