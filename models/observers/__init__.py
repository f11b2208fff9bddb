"""Observers of external joint torque, the check of their samples, and the effects of their lag.

In: q, v, motor torque, the model's terms, friction, torque error. Out: tau_ext, and whether it is
valid. Order: sample_check; observer (the protocol), observer_kinds, signals, period_torque;
momentum_observer; kalman_kernels, kalman_observer; fixed_interval, force_changes (smoothing of a
log); lag, lag_power (error of a changing force); explained_torque, shifted_torque, fault_signature
(plausibility).
"""
