"""The blocks of a machining pass, besides estimator and impedance controller.

In: the model's terms, the force that is fed back, the estimator's torque. Out: the reference, and
what is taken off the estimate and off the command. Order: machining_reference;
air_pass_correction, tool_vibration_tracker (of the estimate); freed_friction_feedforward (of the
command).
"""
