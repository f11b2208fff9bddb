"""Recognises the layout of a log by the names of its columns, without a description.

In: names of columns, and the robot's joints. Out: a `KnownLayout` (`header_layouts`): the log's
RecordingFormat with notices, or None. `recording_reader` tries them in this order:
`external_torque`, `header_layouts` (known programs), `plain_header` (t,q1..), `column_words`.
"""
