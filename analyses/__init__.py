"""Questions and their answers: runs, measurements, figures, and the command line."""

import os

# The matrices here are small: a second BLAS thread gains nothing on an idle machine, and where
# experiments or tests run side by side, threads that wait for each other in busy loops take most of
# the time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
