"""The correction that an air pass has taught, as a block."""

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from wrenchsight.models.machining.air_pass import (
    AirPassCorrection,
    CorrectionSample,
    CorrectionTable,
    sample_correction,
)
from wrenchsight.systems.declarations import declare_outputs, parts_of


class AirPassCorrectionSystem(LeafSystem):
    """Plays the correction of an air pass along the path.

                     +-------------------------+ --> correction
      feed_time -->  | AirPassCorrectionSystem | --> spread
                     +-------------------------+ --> valid

    Input:    feed_time   (1,) s since the feed started, below 0 before
    Outputs:  correction  (n,) N m, to be added to the observed tau_ext; 0 before the feed starts
                          and after its end
              spread      (n,) N m, how far the correction differs from itself along the path
              valid       (1,) 1 where a corrected reading may be used, else 0
              all         these, one after the other (`systems.declarations.declare_outputs`)
              with direct feedthrough
    State:    none

    Args:
        correction: of `models.machining.air_pass`.
    """

    def __init__(self, correction: AirPassCorrection) -> None:
        LeafSystem.__init__(self)
        n = correction.num_joints
        self._table = CorrectionTable.of(correction)
        self._feed_time = self.DeclareVectorInputPort("feed_time", 1)
        self.output_sizes = {"correction": n, "spread": n, "valid": 1}
        self._parts = parts_of(self.output_sizes)
        declare_outputs(self, self.output_sizes, self._calc_all, {self._feed_time.ticket()})

    def _calc_all(self, context: Context, output: BasicVector) -> None:
        out, parts = output.get_mutable_value(), self._parts
        sample = CorrectionSample(
            correction=out[parts["correction"]],
            spread=out[parts["spread"]],
            counts=out[parts["valid"]],
        )
        sample_correction(self._table, self._feed_time.Eval(context).item(), sample)
