"""The command `identify`: logs in, a model with its friction and torque error out.

Order: identification_config (settings), low_passed_logs (logs through the filter), torque_fit and
friction_fit (least squares), friction_training (the network), law_fits and law_choice (friction
laws by held-out error), repeated_motion and torque_error_learning (the observer's error),
identification_checks, identification (all of it), identification_report and identification_figures.
`known_model` has what changes a model that is there: --refresh, --load, --scale, --other-specimen.
"""
