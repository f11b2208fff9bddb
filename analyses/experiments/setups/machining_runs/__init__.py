"""The simulated arm at work on a plate or a blade, with and without a sensor, and read.

In: a machining task. Out: its runs, readings of the force, figures and notes, feed by feed.
Files: `machining` (one run), `machining_study` (all feeds), `machining_figures`.
"""
