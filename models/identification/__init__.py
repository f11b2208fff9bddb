"""The model of one robot, identified from its logs: inertias, friction and torque error.

In: rows of a regression and held-out readings. Out: an `IdentifiedModel` and its file, or a URDF.
Order: least_motion, torque_regression, base_parameters, physical_consistency, gravity_spread,
torque_error_fit, torque_error_model, repetition_error, contact_noise, fitted_robot,
identified_model, then simulator_friction, identified_urdf.
"""
