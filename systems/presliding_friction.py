"""Joint friction with memory as a block."""

from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.systems.friction_law import FrictionLawSystem


class PreslidingFrictionSystem(FrictionLawSystem):
    """Predicts the friction torque of every joint by a law with memory.

                 +--------------------------+
      q     -->  |                          |
      v     -->  | PreslidingFrictionSystem | --> tau_f
      tau_J -->  |                          |
                 +--------------------------+

    Ports, state and parameters are those of FrictionLawSystem.

    Args:
        friction: the law; its velocity law (with networks, if any) is fixed.
        time_step: s.
        knows_rest: as FrictionLawSystem.

    Raises:
        ValueError: the law has no memory (use SemiParametricFrictionSystem), or no period.
    """

    def __init__(self, friction: FrictionLaw, time_step: float, knows_rest: bool = False) -> None:
        if friction.state_rows == 0:
            raise ValueError("friction: a law without memory needs no PreslidingFrictionSystem")
        FrictionLawSystem.__init__(self, friction, time_step, knows_rest)
