"""Numerics: arrays and their views, compiled kernels, and small pieces of linear algebra.

arrays and views name what kernels read, kernel compiles and caches them, row_blocks splits long
batches; small_matrices, autodiff, bounded_minimum and ties serve the sub-packages above.
"""
