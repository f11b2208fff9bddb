"""Before numpy is imported, here and in the processes that the tests start."""

import analyses  # noqa: F401  (chooses the number of BLAS threads)
