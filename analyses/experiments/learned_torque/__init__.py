"""The experiment `learned-torque`: `arms` fits and reads the logs, `experiment` judges them."""
