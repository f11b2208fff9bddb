"""What is known about a robot, its task and its friction: data and pure mathematics.

In: files and arrays. Out: arrays. Order, lowest sub-package first: numerics, files, rigid_body;
signals, friction, robot; recordings, identification; observers, calibration; estimation; detection,
control, planning; live, machining; truth (the simulated arm). `robots` and `tasks` hold bundled
files.
"""
