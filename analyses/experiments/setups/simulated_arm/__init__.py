"""The simulated arm's models, learnt from its contact-free logs.

In: a robot with its simulated truth. Out: a model for each friction law, with its torque error.
Files: `simulated_identification`, `friction_reversal`, `arm_models`.
"""
