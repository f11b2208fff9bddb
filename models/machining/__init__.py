"""Machining passes: their plan, their phases, their process forces, and what makes them readable.

In: a surface, a feed and a normal force. Out: the reference of each tick, and the torque to take
off the observer's. Order of the files: `machining_path` plans, `machining_phases` and
`machining_reference` lead the tool along the plan. `air_pass` learns what repeats of the model's
error, `tool_vibration` the friction that the tool shakes free, which `freed_feedforward` takes off
the command. `machining_process` with `process_variations` is the simulated process.
"""
