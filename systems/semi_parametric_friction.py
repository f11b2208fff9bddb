"""Joint friction from joint velocity."""

from wrenchsight.models.friction.velocity_friction import SemiParametricFriction
from wrenchsight.systems.friction_law import FrictionLawSystem


class SemiParametricFrictionSystem(FrictionLawSystem):
    """Predicts the friction torque of every joint by the article's semi-parametric law.

        tau_f = network(v) + bias + slope v             |v| ≤ v_crit
                coulomb sgn(v) + viscous v + offset     |v| > v_crit

    (Lu et al., eq. 12). Bias and slope make both meet at ±v_crit unless `friction.handover` is
    "literal"; without networks the law is Coulomb-viscous at every velocity
    (`wrenchsight.models.friction.velocity_friction.SemiParametricFriction`).

             +------------------------------+
      v -->  | SemiParametricFrictionSystem | --> tau_f
             +------------------------------+

    Input:       v         (n,) rad/s (m/s if prismatic)
    Output:      tau_f     (n,) N m, opposes motion: positive for positive velocity, on the left of
                           M vdot + C v + G + tau_f = tau_J + tau_ext; direct feedthrough
    State:       none
    Parameters:  coulomb   (n,) N m
                 viscous   (n,) N m s/rad
                 offset    (n,) N m
                 v_crit    (n,) rad/s

    The networks are fixed. A velocity that is not finite gives a torque that is not finite; the
    observer flags it and holds.
    """

    def __init__(self, friction: SemiParametricFriction) -> None:
        FrictionLawSystem.__init__(self, friction)
