"""Laws of joint friction, as tables that kernels read.

In: position, velocity and transmitted torque of the joints. Out: friction torque tau_f, N m.
Order: friction_law (the protocol); velocity_friction with friction_network; slip_elements and
presliding_friction; laws on top of others: friction_terms, extended_friction, coupled_friction,
path_friction; friction_structure for fits; sliding_friction and sliding_level for drift and errors.
"""
