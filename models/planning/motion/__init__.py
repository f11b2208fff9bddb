"""Motions of an arm: paths, surfaces, inverse kinematics, and measures of postures.

In: a robot, and poses, paths or surfaces for its tool. Out: postures, trajectories, measures.
Order: damped_least_squares, branches, inverse_kinematics, path_postures (postures of poses); paths,
workpieces, surface_path, joint_ranges (what to follow); posture_cost; redundancy, posture_map.
"""
