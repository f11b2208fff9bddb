"""The simulated true robot as blocks; no controller or estimator may see inside them.

In: the motors' current command, the plant's state and contact results. Out: what encoders, drives
and force/torque sensor read, and the truth. Order: tool_contacts, true_arm.
"""
