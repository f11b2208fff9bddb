"""Control laws of the arm, and the wrench that a scenario puts on its tool.

In: the model's terms, a reference, a wrench. Out: the commanded joint torque, N m.
Order: joint_tracking; impedance; wrench_script.
"""
