"""The simulated true robot: joints with mechanisms that no estimator's model contains.

In: commands or a trajectory, and the robot's simulated truth. Out: what encoders and drives report,
and the truth. Order: true_robot, true_joints (constants), joint_kernels, arm_tick (a tick of the
cell), free_arm (fast logs without contact), log_clock; worlds draws truths for a campaign.
"""
