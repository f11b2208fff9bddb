"""LeRobot's data sets: each episode is read as a log, and a copy of the set gains a wrench.

In: the folder of a data set. Out: tables of frames and the layout of their columns; a new folder.
Order: `data_set`, `episode_table`, `feature_layout`, `data_set_copy`.
"""
