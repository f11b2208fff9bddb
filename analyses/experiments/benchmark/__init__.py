"""A benchmark of force estimation without a sensor: several methods, measured alike on real logs.

The files in the order in which data passes them: `data_sets` (which recordings a task needs), `arm`
(the UR10e, its models and how each method reads it), `entrants` (estimators of others), a file for
each task, `scores` (a figure with its spread), `page` (the tables).
"""
