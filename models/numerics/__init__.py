"""Numerics: arrays and their views, compiled kernels, and small pieces of linear algebra.

arrays and views name what kernels read, states puts several arrays into one vector, kernel compiles
and caches, row_blocks splits long batches; small_matrices, sparse_products, autodiff,
bounded_minimum and ties serve the sub-packages above.
"""
