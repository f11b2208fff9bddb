"""Distances between links, tool, floor, obstacles and workpiece.

In: a robot, its surroundings, postures or a planned motion. Out: distances, pairs that are too
near, sentences about them. Order: arm_shapes (the geometry); clearance (a motion); placement_cell,
coming_and_going (a placed path and its ends); machining_way, links_apart (a machining pass).
"""
