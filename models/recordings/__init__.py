"""Reads robot logs of any format into checked recordings in SI units, and writes them.

In: a log file, its description (`recording_format`) and the robot. Out: a `recording`, chunk by
chunk, and notices. Order: `log_container` (protocol), `log_containers` with `text_table` (whose
begin `text_head` finds), `npz_table`, `parquet_table` and what becomes such a table, `rosbag`,
`lerobot` (a table of numbers), `table_checks`; `long_table` and `aligned_table` (a row a sample);
`layouts` (what its columns mean), `log_words`; `recording_reader` with `differentiation`;
`recording_checks` with `plausibility` and `position_resolution`; `episodes_reader`, `resampling`,
`recording_writer`.
"""
