"""Output of commands: result folders, JSON, YAML, figures, tables and progress.

In come plain values, figures and sentences; out go files that are written whole or not at all, and
lines on the terminal. Order: outputs (files of one folder), result_marker and result_folder (a
folder that changes as one), marked_page, figures and axes, stream_summary, console, progress and
compilation, interruption (signals), side_by_side (calls in processes).
"""
