"""The command `redundancy`: a surface path in, the redundant angle along it out.

Order: redundancy_task (settings), redundancy (the best angles), free_redundancy (without
collision), redundancy_results (what is written).
"""
