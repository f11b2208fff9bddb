"""What several experiments share: the arms, runs and recordings that they measure on.

In: a robot or a folder of recordings. Out: runs, models and readings. Simulated: simulated_arm,
path_runs, machining_runs. Real: ur10e_recordings, lara8_recordings, panda_recordings.
"""
