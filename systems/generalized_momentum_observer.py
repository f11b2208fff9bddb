"""The momentum observer as a block."""

from wrenchsight.models.observers.momentum_observer import MomentumObserver, MomentumObserverConfig
from wrenchsight.systems.external_torque_observer import ExternalTorqueObserver


class GeneralizedMomentumObserver(ExternalTorqueObserver):
    """Estimates the external joint torque from the generalized momentum.

        d/dt momentum_hat = tau_J - tau_f + CTv - G + tau_ext
        tau_ext           = K_0 (momentum - momentum_hat)

    so that tau_ext is the true external torque through K_0 / (s + K_0) (Lu et al., eqs. 6-11, 30).
    The sign is that of the environment on the robot. The article's tau_ext, which is what the
    motors spend against the environment, is the negative of this one. Sampled with the period T,
    exactly (`wrenchsight.models.observers.momentum_observer`):

        tau_ext_k+1 = a tau_ext_k + (1 - a) (mean of the true tau_ext over the tick),
        a = exp(-K_0 T)

                    +-----------------------------+ --> tau_ext
      terms    -->  |                             | --> valid
      tau_J    -->  | GeneralizedMomentumObserver | --> reading
      tau_f    -->  |                             | --> pole
                    +-----------------------------+

    Inputs:     terms    RigidBodyTerms (abstract): momentum, CTv, G of the model
                tau_J    (n,) motor torque on the joint side, N m
                tau_f    (n,) friction torque that opposes motion, N m
    Outputs:    tau_ext  (n,) N m, positive along the motion it causes; reflects everything up to
                         the present tick. With torque samples "held" (the drive holds tau_J until
                         the next tick) it does not feed through from tau_J, so that a
                         controller may close a loop over it; with "trapezoidal" it does
                valid    (1,) 1, or 0 where tau_ext is the last one, held, and for the first 3 / K_0
                         seconds, in which it is still settling from zero
                reading  these two, one after the other in one port, of `reading_sizes`
                pole     (n,) K_0 as it is now, for blocks that depend on it
    State:      memory, which `take_sample` updates at each tick: (3, n): momentum_hat, kg m^2/s,
                what the model predicts for the coming tick (inf before the first update, NaN after
                an unusable one); tau_ext, N m; the share of tau_ext that is still its start at zero
    Parameter:  K_0      (n,) 1/s

    Prerequisite: evaluated at its ticks (t = 0, T, 2T...); in between, the value is that of a tick
    that came early.

    Before the first update tau_ext is zero. A sample that is not finite, in any input, never
    reaches tau_ext. The joint keeps its last estimate and sets `valid` to 0. It continues from that
    estimate with the second finite sample that follows.

    Args:
        config: K_0, period and kind of the torque samples.
        num_joints: n.

    Raises:
        ValueError: as `wrenchsight.models.observers.momentum_observer.MomentumObserver`.
    """

    uses_sd = False

    def __init__(self, config: MomentumObserverConfig, num_joints: int) -> None:
        ExternalTorqueObserver.__init__(self, MomentumObserver(config, num_joints))
