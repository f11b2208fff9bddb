"""A recurrent network that predicts contact-free torque, instead of a model and on top of it.

In: contact-free logs and an identified model. Out: predicted torque, and the error of the force.
Files: `recurrent_network`, `torque_predictors`.
"""
