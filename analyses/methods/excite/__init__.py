"""The command `excite`: a robot in, a motion that determines its parameters out.

Order: excitation_config (settings), excitation (search, checks and files).
"""
