"""The order of a wrench's six numbers.

In code rotation comes first: [moment; force], [angular; linear]. In files, tables and figures for
people force comes first.
"""

AXES = ("x", "y", "z")
WRENCH_AXES = ("fx", "fy", "fz", "mx", "my", "mz")  # as people read them

# From one order to the other, either way: `wrench[..., FORCE_FIRST]`.
FORCE_FIRST = [3, 4, 5, 0, 1, 2]
