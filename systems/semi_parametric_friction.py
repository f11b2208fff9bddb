"""Joint friction without memory as a block."""

from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.systems.friction_law import FrictionLawSystem


class SemiParametricFrictionSystem(FrictionLawSystem):
    """Predicts the friction torque of every joint by the article's semi-parametric law, eq. 12.

             +------------------------------+
      v -->  | SemiParametricFrictionSystem | --> tau_f
             +------------------------------+

    Bias and slope make both parts of the law meet at ±v_crit, unless `friction.handover` is
    "literal". Without networks the law is Coulomb-viscous at every velocity. No state; ports and
    parameters are those of FrictionLawSystem.
    """

    def __init__(self, friction: SemiParametricFriction, knows_rest: bool = False) -> None:
        FrictionLawSystem.__init__(self, friction, knows_rest=knows_rest)
