"""What an air pass has taught, played back along the path."""

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from wrenchsight.models.machining.air_pass import TaughtTorque, taught_tick


class TaughtTorqueSource(LeafSystem):
    """Minus the model's error at a place of the motion, as `air_pass` learnt it.

                      +--------------------+ --> tau_correction
      feed_time  -->  | TaughtTorqueSource | --> counts
                      +--------------------+ --> taught

    Input:   feed_time       (1,) s since the feed started; below 0 while it has not
    Outputs: tau_correction  (n,) N m, to be added to the observer's tau_ext; zero before the feed
                             and after its end
             counts          (1,) 1 where a reading so corrected may be used, else 0: where joints
                             rest, start or reverse
             taught          (n + 1,) these two, one after the other, in one port
             All with direct feedthrough
    State:   none

    Args:
        taught: by an air pass along the same motion, read behind the same observer.
    """

    def __init__(self, taught: TaughtTorque) -> None:
        LeafSystem.__init__(self)
        assert taught.steady is not None
        self._tick = (taught.tau_ext, taught.steady, float(taught.t[1]))
        self._feed_time = self.DeclareVectorInputPort("feed_time", 1)
        self.DeclareVectorOutputPort(
            "tau_correction", taught.num_joints, self._calc, {self._feed_time.ticket()}
        )
        self.DeclareVectorOutputPort("counts", 1, self._calc_counts, {self._feed_time.ticket()})
        self._both = self.DeclareVectorOutputPort(
            "taught", taught.num_joints + 1, self._calc_taught, {self._feed_time.ticket()}
        )

    def _calc_taught(self, context: Context, output: BasicVector) -> None:
        feed_time = float(self._feed_time.Eval(context)[0])
        taught_tick(*self._tick, feed_time, output.get_mutable_value())

    def _calc(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._both.Eval(context)[:-1])

    def _calc_counts(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._both.Eval(context)[-1:])
