"""Evidence for units and signs of a log's currents and torques, gathered sample by sample.

In: chunks of a `Recording` and the robot. Out: a sentence, and a decision of `recording_reader` or
`recording_checks`. Order: `product_sums`, `effort_unit` (N m or A), `drive_evidence` (signs).
"""
