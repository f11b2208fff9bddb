"""The arms that are studied: their logs, and the models learnt from these."""
