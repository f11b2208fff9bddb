"""Calibration of an identified model: friction of today, loads, torque per ampere.

In: residuals of a model over logs, or readings of an observer. Out: changes of its parameters, each
with its standard error, or a disagreement that a user is warned of. Order of the files:
1. rows and least squares: residual_noise, prior_least_squares, load_parameters, model_uncertainty,
   observed_regressor
2. friction that has drifted:
   - friction_drift_criterion: whether a log's friction contradicts the model's, to warn of it
   - friction_refresh: today's coefficients from seconds of free motion
   - friction_beside_contact: the same from a log in which something touches
   - friction_tracking: the drift followed sample by sample, and taken from the reading
   - specimen_friction: the whole law of another robot of the same make
   (`analyses.methods.estimate.friction_monitor` applies them to a log; `hypotheses.friction_drift`
   asks whether drift explains a log that does not suit its model)
3. loads: load_identification, mass_across_joints, load_or_drift,
   payload_zero, known_tool
4. drives: gain_at_rest, gain_calibration, effort_scale
"""
