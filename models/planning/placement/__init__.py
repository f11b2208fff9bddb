"""What a placement of a straight path is (command `place`): its task, its bounds, its postures.

In: a task (path, box, limits, clearance), a robot. Out: bounds, placements, postures along them.
Order: placement_task, placements. The program that finds the best one is in
`wrenchsight.diagrams.placement`, the search in `wrenchsight.analyses.methods.place`.
"""
