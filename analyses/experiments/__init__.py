"""Experiments of `study`: a folder each, whose `experiment.py` holds its EXPERIMENT.

A folder holds all that only its experiment needs; what several share is in `setups`. No experiment
imports another.
"""
