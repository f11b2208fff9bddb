"""The experiment `foreign-physics`: arms simulated in MuJoCo, read as a user reads a log.

Nothing of the world is this project's but the arm's file: contact, friction, integrator and solver
are MuJoCo's. Order of the files: arms (which ones, how the true one differs from its file),
motions, scenes and cases (what happens in a log), mujoco_world (simulates and logs),
identified_arms (models from two motions of `excite`), plain_tools (least squares, observer,
pinv(J^T)), readings (`estimate` against the truth), drawn_arm (all of one draw).
`python -m wrenchsight.analyses.experiments.foreign_physics --help` makes one log by hand.
"""
