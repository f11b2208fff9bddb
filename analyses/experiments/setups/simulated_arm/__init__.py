"""The simulated arm's models, learnt from its own contact-free logs."""
