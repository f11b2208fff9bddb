"""Runs experiments, keeps their results and reports on them. Knows no robot."""
