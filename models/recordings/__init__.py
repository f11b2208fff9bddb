"""Reads robot logs of any format into checked recordings in SI units, and writes them.

In: a log file, its description (`recording_format`) and the robot. Out: `Recording`s, chunk by
chunk, and notices. Order: `log_containers` (a table of numbers), `layouts` (what its columns mean),
`recording_reader`, `recording_checks`, `episodes_reader`, `resampling`, `recording_writer`.
"""
