"""Calibration of an identified model: friction of today, loads, torque per ampere.

In: residuals of a model over logs, or readings of an observer. Out: changes of its parameters, each
with its standard error, or a disagreement that a user is warned of. Order of the files:
1. rows and least squares: residual_noise, prior_least_squares, load_parameters, model_uncertainty,
   observed_regressor
2. friction: friction_refresh, friction_disagreement, friction_tracking, specimen_friction
3. loads: load_identification, mass_across_joints, load_or_drift,
   payload_zero, known_tool
4. drives: gain_at_rest, gain_calibration, effort_scale
"""
