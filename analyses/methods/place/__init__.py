"""The command `place`: a task in, the placement of its path with the best measure out.

Order: place_settings, placement (the search; particle_swarm is the article's PSO-GA),
placement_result, placement_files (what is written).
"""
