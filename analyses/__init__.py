"""Questions and their answers: runs, measurements, figures, and the command line.

In: options, logs, settings. Out: folders of results, tables, pages. Order: output and data_sets
(tools), study (experiments and their report), methods (what a command does), commands (its options
and its table), experiments, campaign (experiments in many worlds); __main__ is the program.
"""

import os

# The matrices here are small: a second BLAS thread gains nothing on an idle machine, and where
# experiments or tests run side by side, threads that wait for each other in busy loops take most of
# the time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
