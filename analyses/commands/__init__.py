"""Commands: one module a command, with its options, its call and its output.

A module here with a function `command` is a command of its name (`jcn_map` is `jcn-map`). An
installed package adds one by an entry point of the group wrenchsight.commands. Help reads the first
lines of their docstrings without importing them (discovery); options makes options from settings.
"""
