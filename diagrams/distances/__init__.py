"""Distances between links, tool, floor, obstacles and workpiece: one module for all that ask.

In: a robot, its surroundings, postures or a planned motion. Out: distances, pairs that are too
near, sentences about them. Order: arm_shapes (the geometry); clearance (pairs, what each must keep,
a motion's proof); moved_along; machining_way, links_apart (a machining pass).
"""
