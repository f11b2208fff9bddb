"""Joint friction with memory from joint position, velocity and motor torque."""

from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.systems.friction_law import FrictionLawSystem


class PreslidingFrictionSystem(FrictionLawSystem):
    """Predicts the friction torque of every joint by a law with memory.

        tau_f = velocity_law(v) + cubic v³ + (coulomb + stribeck exp(-(v / v_s)²) + load |L|) z
        z     = Σ_k weight_k z_k,    z_k ← clip(z_k + Δq / displacement_k, -1, 1)

    with L the torque that the gear transmitted at the tick before, tau_J - tau_f
    (`wrenchsight.models.friction.presliding_friction`).

                 +--------------------------+
      q     -->  |                          |
      v     -->  | PreslidingFrictionSystem | --> tau_f
      tau_J -->  |                          |
                 +--------------------------+

    Inputs:      q      (n,) rad (m if prismatic)
                 v      (n,) rad/s (m/s)
                 tau_J  (n,) motor torque on the joint side, N m; read by the update alone
    Output:      tau_f  (n,) N m, opposes motion: positive for positive velocity, on the left of
                        M vdot + C v + G + tau_f = tau_J + tau_ext; direct feedthrough of q and v,
                        not of tau_J
    State:       (2 + K, n), row by row: position at the last tick, transmitted torque, K slips z_k;
                 updated every `time_step`. Before the first tick the elements are relaxed.
    Parameters:  slip   (n, 10 + 2 K), row by row: coulomb N m, stribeck N m, 1 / v_s s/rad, load,
                        cubic N m s³/rad³, fitted speed rad/s, slope of the cubic part beyond it
                        N m s/rad, half the encoder's step rad, period s, share of the slip that a
                        tick at rest leaves, K weights, K displacements rad

    Position or velocity that is not finite gives a torque that is not finite, which the observer
    flags; the state keeps what it knew, and the displacement over the gap counts afterwards.

    Args:
        friction: the law; its velocity law (with networks, if any) is fixed.
        time_step: s.

    Raises:
        ValueError: the law has no memory (use SemiParametricFrictionSystem), or no period.
    """

    def __init__(self, friction: FrictionLaw, time_step: float) -> None:
        if friction.state_rows == 0:
            raise ValueError("friction: a law without memory needs no PreslidingFrictionSystem")
        FrictionLawSystem.__init__(self, friction, time_step)
