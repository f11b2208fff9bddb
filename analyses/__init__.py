"""Questions and their answers: runs, measurements, figures, and the command line."""
