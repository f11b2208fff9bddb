"""A recurrent network that predicts contact-free torque, against a model and on top of it."""
