"""Rigid-body mathematics of a serial chain: arrays in, arrays out, and no knowledge of files.

In: q, v, vdot. Out: the terms of the equation of motion, poses, Jacobians, condition numbers.
Order: spatial_vectors, rotations, vector_kernels (tools); rigid_body_terms, chain_kernels,
chain_batches, serial_chain; conditioning, structural_rank.
"""
