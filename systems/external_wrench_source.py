"""A scripted wrench at the tool, as a block."""

import numpy as np
from numpy.typing import ArrayLike
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from wrenchsight.models.control.wrench_script import WrenchScript


class ExternalWrenchSource(LeafSystem):
    """Applies a scripted wrench to the tool at E, such as a hand, a load or a test signal.

        wrench_true(t) = script(t)

                 +----------------------+
                 |                      | --> spatial_forces
                 | ExternalWrenchSource |
                 |                      | --> wrench_true
                 +----------------------+

    Outputs:    spatial_forces  list of one ExternallyAppliedSpatialForce (abstract), for the plant
                wrench_true     (6,) F_E_W, environment on robot at E, axes of W, rotation first:
                                N m, N
    State:      none

    Args:
        script: the wrench as a function of time.
        body_index: the body that E is fixed to.
        p_BE: (3,) E in that body, m.
    """

    def __init__(self, script: WrenchScript, body_index: BodyIndex, p_BE: ArrayLike) -> None:
        LeafSystem.__init__(self)
        self._script = script
        self._body_index = body_index
        self._p_BE = np.array(p_BE, dtype=np.float64)
        self._wrench_true = self.DeclareVectorOutputPort(
            "wrench_true", 6, self._calc_wrench_true, {self.time_ticket()}
        )
        self.DeclareAbstractOutputPort(
            "spatial_forces",
            Value[list[ExternallyAppliedSpatialForce]],
            self._calc_spatial_forces,
            {self.time_ticket()},
        )

    def _calc_wrench_true(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._script.sample(context.get_time()))

    def _calc_spatial_forces(self, context: Context, output: AbstractValue) -> None:
        applied = ExternallyAppliedSpatialForce()
        applied.body_index = self._body_index
        applied.p_BoBq_B = self._p_BE
        applied.F_Bq_W = SpatialForce(self._wrench_true.Eval(context))
        output.set_value([applied])
