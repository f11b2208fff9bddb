"""Placement of a path over inverse-kinematics constraints, in one plant.

In: a robot, bounds, a posture measure, distances to keep. Out: a MathematicalProgram that is solved
from any start. Order: placement_plant (arm, path, workpiece and obstacles as bodies),
placement_program (constraints and cost).
"""
