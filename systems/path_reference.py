"""A joint trajectory as a reference, as a block."""

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from wrenchsight.models.planning.motion.paths import JointTrajectory


class PathReference(LeafSystem):
    """Plays a joint trajectory.

                 +---------------+
                 | PathReference | --> reference
                 +---------------+

    Output:     reference  (3n,) q_d, v_d, vdot_d at the time of the Context: rad, rad/s, rad/s^2;
                           at rest before the trajectory's first time and after its last
    State:      none

    Args:
        trajectory: times, positions, velocities, accelerations.
    """

    def __init__(self, trajectory: JointTrajectory) -> None:
        LeafSystem.__init__(self)
        self._trajectory = trajectory
        self.DeclareVectorOutputPort(
            "reference", 3 * trajectory.num_joints, self._calc_reference, {self.time_ticket()}
        )

    @property
    def trajectory(self) -> JointTrajectory:
        """The trajectory that is played."""
        return self._trajectory

    def _calc_reference(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._trajectory.reference(context.get_time()))
