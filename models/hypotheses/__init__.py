"""Hypotheses on what is wrong with a log, tested together: one sentence with its odds.

A log whose description is wrong holds valid numbers. It is only beside a robot, in `case`, that
they make no sense: the torque that the drives report is not the one that the motion needs. Each
hypothesis (a file each, listed in `registry`) changes the log as if it were true, and `evidence`
compares it with the log as it is, in which a force at the tool, a load and drifted friction explain
what they can. `judgement` says which one explains the log, at which odds, and what to do.

In: `log_rows` of a log, a robot, a model. Out: a `Judgement`.
"""
