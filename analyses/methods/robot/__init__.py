"""The command `robot`: a URDF in, the draft of a robot.yaml out.

Order: robot_draft.
"""
