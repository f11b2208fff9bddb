"""Planning: excitation (a motion that determines parameters), motion (paths, postures, redundancy)
and placement (where a path lies best).

In come a robot and a task; out come joint motions and placements. Order: motion, then excitation
and placement, which use it.
"""
