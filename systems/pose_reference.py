"""A reference for E from a joint reference, as a block."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from wrenchsight.models.rigid_body.desired_pose import POSE_REFERENCE_SIZE, desired_pose
from wrenchsight.models.rigid_body.serial_chain import SerialChain


class PoseReference(LeafSystem):
    """Computes the pose and velocity of E along a joint reference, for a controller of the tool.

                      +---------------+
      reference  -->  | PoseReference | --> pose_reference
                      +---------------+

    Input:   reference       (3n,) q_d, v_d, vdot_d: rad, rad/s, rad/s^2
    Output:  pose_reference  (18,) of the desired frame D, its parts those of
                             `models.rigid_body.desired_pose`; direct feedthrough
    State:   none

    Args:
        chain: kinematics of the arm up to E.
    """

    def __init__(self, chain: SerialChain) -> None:
        LeafSystem.__init__(self)
        self._chain = chain
        self._n = chain.num_joints
        self._reference = self.DeclareVectorInputPort("reference", 3 * self._n)
        self.DeclareVectorOutputPort(
            "pose_reference",
            POSE_REFERENCE_SIZE,
            self._calc_pose_reference,
            {self._reference.ticket()},
        )

    def _calc_pose_reference(self, context: Context, output: BasicVector) -> None:
        n = self._n
        reference = self._reference.Eval(context)
        terms = self._chain.terms(reference[:n], reference[n : 2 * n])
        pose = np.empty(POSE_REFERENCE_SIZE)
        desired = desired_pose(pose)  # views
        desired.R_WD[:], desired.p_WD[:], desired.V_WD[:] = terms.R_WE, terms.p_WE, terms.V_WE
        output.SetFromVector(pose)
