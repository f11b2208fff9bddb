"""Recognises the layout of a log by the names of its columns, without a description.

In: names of columns, and the robot's joints. Out: a `RecordingFormat` with notices, or None.
Tried in this order: `external_torque`, `header_layouts` (known programs), `array_layout`,
`plain_header` (t,q1..).
"""
