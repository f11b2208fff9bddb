"""Methods: what the commands do, one sub-package a command, and what several of them share.

In come settings and files; out come typed results and folders of results. The sub-package of a
command has its name. `reference_sensor` and `external_torque` serve several commands,
`identify/known_model` updates a model that exists.
"""
