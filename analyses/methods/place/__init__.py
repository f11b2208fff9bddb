"""The command `place`: a task in, the placement of its path with the best measure out.

Order: place_settings, placement (all steps), placement_search (many starts of one program),
placement_refinement (an optimum's exact place), infeasibility (why there is none), particle_swarm
(the article's PSO-GA), placement_result, placement_files (what is written).
"""
