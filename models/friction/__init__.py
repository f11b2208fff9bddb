"""Laws of joint friction, as tables that kernels read.

In: position, velocity and transmitted torque of the joints. Out: friction torque tau_f, N m.
Order: friction_law (the protocol); coulomb_viscous; semi_parametric_friction, the article's law,
with the weights of friction_network; slip_elements and presliding_friction; laws on top of others:
friction_terms, extended_friction, coupled_friction, path_friction; friction_structure for fits;
sliding_friction and sliding_level for drift and errors.
"""
