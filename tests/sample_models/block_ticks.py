"""Ticks of a sampled block that stands alone, without a Simulator."""

MEMORY = 0
"""Group of discrete state that is the memory of a `SampledBlock`."""


def state_after_tick(block, context):
    """The discrete state of a block after the tick that `context` is at; `context` stays."""
    after = context.Clone()
    block.CalcForcedUnrestrictedUpdate(context, after.get_mutable_state())
    return after.get_discrete_state()


def memory_after_tick(block, context):
    """Its memory then, flat."""
    return state_after_tick(block, context).get_vector(MEMORY).CopyToVector()


def take_tick(block, context):
    """Takes the tick that `context` is at."""
    context.SetDiscreteState(state_after_tick(block, context))
