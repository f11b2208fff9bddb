"""Questions and their answers: what a command does, without its options."""
