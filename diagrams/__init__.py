"""Drake Diagrams built from `systems` and MultibodyPlant. Nothing here advances time.

In: a scenario, a robot, its identified model. Out: Diagrams, and web pages of their motion.
Order: scenario, fitted_scenario, workpiece, robot_cell (the truth), machining (its pass),
estimator, closed_loop (all of them), kept_signals; held_arm; graph; `distances` (collisions),
`placement` (the program of `place`) and `pages` (pictures).
"""
