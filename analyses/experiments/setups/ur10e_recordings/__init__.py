"""The UR10e's recordings, its known payload, its runs in contact, and twins of its logs.

In: the folder of recordings. Out: models, logs with their truth, and readings of contact runs.
Files: `ur10e_logs`; `known_payload`, `log_scenes` (loads); `contact_runs`, `contact_reading`
(contact); `contact_trials` (detection); `twin_logs`, `log_figures`.
"""
