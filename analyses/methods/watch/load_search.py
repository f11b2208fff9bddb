"""Load search: looks for an unmodelled load at the tool while a stream runs.

All readings since the stream began are weighed after LOOK_TIMES seconds, as `estimate` weighs a
log's, until a load shows. A look takes some 0.2 s: at real time it runs in a thread of its own, so
that no sample waits for it.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError

from wrenchsight.analyses.methods.estimate.friction_monitor import FrictionMonitor
from wrenchsight.analyses.methods.watch.stream_judgement import LONGEST_GAP
from wrenchsight.models.calibration.load_identification import LoadPrior
from wrenchsight.models.calibration.load_or_drift import LoadOrDrift, weigh
from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import Sample
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.robot.robot import Robot

LOOK_TIMES = (5.0, 10.0, 20.0, 40.0)  # s since the stream began
SETTLING_TIME = 1.0  # s of readings that are left out at the beginning
LEAST_MASS = 0.5  # kg, below which a load is not reported


class _Speed(NamedTuple):
    """Velocity of the joints at a sample: t in s, v (n,) in rad/s."""

    t: float
    v: Array


class LoadSearch:
    """Gathers what is read of one stream, and looks for a load.

    Args:
        robot, model: of the arm.
        in_background: whether a look runs in a thread of its own.
    """

    def __init__(self, robot: Robot, model: IdentifiedModel, in_background: bool = False) -> None:
        self._robot, self._model = robot, model
        self._in_background = in_background
        self._pool: ThreadPoolExecutor | None = None
        self.restart()

    def restart(self) -> None:
        """The stream begins anew; what a look finds that still runs is not reported."""
        self._running: Future[LoadOrDrift | None] | None = None
        self._begin: float | None = None  # s, of the stream; None: no sample has come
        self._looks = list(LOOK_TIMES)  # s after the begin, of the looks to come
        # Gathered since the last look; all readings so far are in the monitor.
        self._speeds: list[_Speed] = []
        self._readings: list[Reading] = []
        self._estimator: WrenchEstimator | None = None
        self._monitor: FrictionMonitor | None = None

    @property
    def is_over(self) -> bool:
        """Whether the search has ended."""
        return not self._looks and self._running is None

    def add_sample(self, sample: Sample) -> None:
        """Takes the next sample of the stream."""
        if self.is_over:
            return
        if self._speeds and sample.t - self._speeds[-1].t > LONGEST_GAP:
            self.restart()
        self._begin = sample.t if self._begin is None else self._begin
        self._speeds.append(_Speed(sample.t, sample.v))

    def add_reading(self, reading: Reading) -> None:
        """Takes the next reading of the stream."""
        if self._looks and self._begin is not None and reading.t >= self._begin:
            self._readings.append(reading)

    def look(self, t: float, estimator: WrenchEstimator) -> None:
        """Begins a look where one is due; `result` gives what it finds.

        A look hands the speeds and readings gathered since the last one to the monitor, and weighs
        all that the monitor has. None is due before `result` has given what the last one found.

        Args:
            t: s, of the stream.
            estimator: that gives the readings; another one than before means that reading began
                anew.
        """
        if self._estimator is not estimator:
            self._read_by(estimator, t)
        if self._begin is None or not self._looks or self._running is not None:
            return
        if t - self._begin < self._looks[0]:  # not due
            return
        self._looks.pop(0)
        # The last speed stays: the next look interpolates from it.
        speeds, self._speeds = self._speeds, self._speeds[-1:]
        readings, self._readings = self._readings, []
        observer = estimator.observer
        if self._monitor is None:
            pole, step = observer.pole, observer.time_step
            self._monitor = FrictionMonitor(self._model, estimator.chain, pole, step, self._robot)
        settled_from = self._begin + max(SETTLING_TIME, observer.settling_time)  # s
        # Until the look is over, the monitor is its thread's alone: no other look begins.
        arguments = self._monitor, speeds, readings, settled_from
        if self._in_background:
            self._pool = self._pool or ThreadPoolExecutor(1)
            self._running = self._pool.submit(self._judge, *arguments)
        else:
            self._running = Future()
            self._running.set_result(self._judge(*arguments))

    def _read_by(self, estimator: WrenchEstimator, t: float) -> None:
        """Forgets the readings of another estimator, and the look at them that may run.

        From t on, s of the stream, the looks that were not held yet are due after their times.
        """
        if self._estimator is not None:
            self._begin, self._readings, self._monitor, self._running = t, [], None, None
        self._estimator = estimator

    def result(self) -> LoadOrDrift | None:
        """The load, once, where a look that is over has shown one."""
        if self._running is None or not self._running.done():
            return None
        load, self._running = self._running.result(), None
        if load is not None:
            self._looks = []
        return load

    def _judge(
        self,
        monitor: FrictionMonitor,
        speeds: list[_Speed],
        readings: list[Reading],
        settled: float,
    ) -> LoadOrDrift | None:
        """Adds the new readings from time `settled` (s) on, and weighs all of them."""
        if readings:
            _add(monitor, speeds, readings, settled)
        rows = monitor.load_rows()
        if rows is None:
            return None
        law, prior = self._model.friction.coulomb_viscous, LoadPrior(self._robot.payload)
        try:
            load = weigh(rows, law, prior)
        except (LinAlgError, ValueError):  # the rows determine no load
            return None
        is_reported = load is not None and load.is_shown and load.load.mass >= LEAST_MASS
        return load if is_reported else None


def _add(
    monitor: FrictionMonitor,
    speeds: list[_Speed],
    readings: list[Reading],
    settled: float,
) -> None:
    """Adds readings to the monitor, with velocities interpolated between the samples'.

    The grid's velocities are linear between two samples likewise.
    """
    t = np.array([reading.t for reading in readings])
    is_later = are_later(t)
    t, readings = t[is_later], [readings[k] for k in np.flatnonzero(is_later)]
    sample_t = np.array([sample.t for sample in speeds])
    is_later = are_later(sample_t)
    sample_t = sample_t[is_later]
    sample_v = np.array([sample.v for sample in speeds])[is_later]
    v = np.stack([np.interp(t, sample_t, joint_v) for joint_v in sample_v.T], axis=1)
    q = np.array([reading.q for reading in readings])
    tau_ext = np.array([reading.tau_ext for reading in readings])
    is_measured = np.array([not (reading.dropout or reading.fault) for reading in readings])
    is_usable = is_measured & (t >= settled) & np.isfinite(v).all(axis=1)
    is_free = np.array([not reading.contact for reading in readings])
    monitor.add(t, q, np.nan_to_num(v), tau_ext, is_usable, is_free)


def are_later(t: Array) -> Flags:
    """(N,) which times are later than all before."""
    return np.asarray(np.r_[True, t[1:] > np.maximum.accumulate(t)[:-1]])
