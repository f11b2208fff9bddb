"""The simulated arm along the article's paths, pushed or repeating its motion, and read.

In: a scenario, a path and models. Out: runs, readings of the force and their errors.
Files: `article_paths`, `task_runs`, `task_variants`, `path_study` (pushed passes);
`repetition_errors`, `repeated_cycles` (repeated motion).
"""
