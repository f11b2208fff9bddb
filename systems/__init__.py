"""Drake LeafSystems, one a file: a piece of `models` mathematics in ports, state and parameters.

In: signals of a robot, real or simulated. Out: estimates, commands and the truth of a simulation.
Order of the estimator: sample_check, rigid_body_terms, motor_current_torque_source, friction_law,
external_torque_observer, torque_error, torque_correction, jacobian_wrench_reconstruction,
contact_detection; or all of them as wrench_estimator. Controllers: *_reference, then *_controller.
`machining`: what a machining pass has besides. `truth`: the simulated arm.
"""
