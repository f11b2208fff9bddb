"""Experiments of `study`: a folder each, whose `experiment.py` holds its EXPERIMENT.

In: an ExperimentContext. Out: metrics, figures, notes, and COMPARISON, the rows that hold the
article's figures. What several experiments share is in `setups`; none imports another.
"""
