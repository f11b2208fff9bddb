"""Runs experiments, keeps their results and reports on them. Knows no robot.

In: names of experiments and settings. Out: a folder of results, a report, and the README's table.
Files: `experiment`, `registry`, `own_methods` (what runs); `study`, `outcome`, `fingerprint`,
`shared_results` (running); `stored_result`, `wording`, `report`, `readme_table` (results).
"""
