"""The command `robot`: a URDF, xacro, SDF or MJCF in, the draft of a robot.yaml out.

Order: draft_assumptions, draft_text, robot_draft; apart, robot_export: an identified arm as a file
for simulators.
"""
