"""One module a command: its options, the call of what does the work, and what is printed.

A module here with a function `command` is a command of its name (`jcn_map` is `jcn-map`); an
installed package adds one by an entry point of the group wrenchsight.commands. Help reads the first
lines of their docstrings without importing them.
"""
