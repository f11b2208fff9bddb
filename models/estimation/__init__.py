"""Estimation of the wrench from motor current: one sample at a time, or over a log.

In: an identified model, and q, v, motor current of each sample. Out: tau_ext, the wrench at E with
its covariance, and `valid`. Order of the files: `estimator` (a user's class) runs the stages of
other sub-packages and two of this one: `torque_error_stage`, and `wrench_reading`, which reads with
`wrench`, `wrench_kernels` and the prior of `wrench_prior`, or that of a log (`evidence_prior`,
`lever_prior`). Beside them: `smoothing`, `reading_gain`, `point_of_action`, `contact_filter` with
`contact_reading`, and the writers `wrench_table` and `wrench_bag`.
"""
