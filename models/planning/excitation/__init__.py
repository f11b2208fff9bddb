"""Motions that identify a robot's parameters (command `excite`).

In: a robot and its limits. Out: a Fourier trajectory, and how much it tells about the parameters.
Order: excitation_limits, fourier_trajectory, excitation_information (the cost), excitation_program
(the optimisation problem); friction_reversal plans and evaluates passes in both directions.
"""
