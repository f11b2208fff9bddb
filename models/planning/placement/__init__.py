"""The best placement of a straight path for a robot (command `place`).

In: a task (path, box, limits, clearance), a robot, a posture measure. Out: placements, best first.
Order: placement_task, placement_program (the optimisation problem), placement_descent (many starts
at once), placement_search (global search), placement_refinement (an optimum's exact place).
"""
