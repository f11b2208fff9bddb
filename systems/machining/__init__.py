"""Control of a machining pass in one block, machining_controller.

In: encoders, drives' current and perhaps a force/torque sensor. Out: the commanded torque, with the
reference of the pass and the estimate of the wrench.
"""
