"""A reference for E from a joint reference, as a block."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from wrenchsight.models.rigid_body.serial_chain import SerialChain

POSE_REFERENCE_SIZE = 18


class PoseReference(LeafSystem):
    """Computes the pose and velocity of E along a joint reference, for a controller of the tool.

                      +---------------+
      reference  -->  | PoseReference | --> pose_reference
                      +---------------+

    Input:   reference       (3n,) q_d, v_d, vdot_d: rad, rad/s, rad/s^2
    Output:  pose_reference  (18,) of the desired frame D: R_WD (9) row by row, p_WD (3) m,
                             V_WD (6) angular then linear velocity in axes of W, rad/s and m/s;
                             direct feedthrough
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
        pose[:9] = terms.R_WE.ravel()
        pose[9:12] = terms.p_WE
        pose[12:] = terms.V_WE
        output.SetFromVector(pose)
