"""Evidence for the unit of a log's effort, gathered sample by sample; signals that stand still.

In: chunks of a `Recording` and the robot. Out: a sentence, and a decision of `recording_reader` or
`recording_checks`. Order: `product_sums`, `effort_unit` (N m or A). What else is wrong with a log
is found by `models.hypotheses`.
"""
