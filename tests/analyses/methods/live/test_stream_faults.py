"""Faults at random moments: nothing wrong is valid, and readings are back in time.

Nothing touches the arm, and the model is the arm's own: what is read is error, and a valid reading
beyond MOST_SD of its stated deviation is wrong.
"""

import random
import time
from dataclasses import replace

import numba
import numpy as np
import pytest
from sample_models import harmonic_motion, sample_torque_error

from wrenchsight.analyses.methods.live.reader_process import read_stream
from wrenchsight.analyses.methods.live.rtde_controller import RtdeController
from wrenchsight.analyses.methods.live.sources import open_source
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveConfig, LiveEstimator
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.rtde import PacketType, packet
from wrenchsight.models.live.samples import EventKind, Sample, StreamEvent
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.recording import Recording

H = 0.002
MOST_SD = 3.0
BACK = 1.0  # s, and the settling time
CONFIG = LiveConfig(WrenchEstimatorConfig(MomentumObserverConfig(time_step=H)))


@pytest.fixture(autouse=True)
def _one_thread():
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)


@pytest.fixture(scope="module")
def model(ur10e):
    """With viscous friction, which repeats exactly."""
    nothing = np.zeros(6)
    friction = SemiParametricFriction(CoulombViscous(nothing, nothing + 5.0, nothing))
    model = IdentifiedModel.nominal(ur10e)
    return replace(model, friction=friction, torque_error=sample_torque_error())


@pytest.fixture(scope="module")
def recording(ur10e, model):
    t = H * np.arange(3000)
    q, v, vdot = harmonic_motion(np.random.default_rng(2), t, [0.7, 1.9], 0.3)
    q += ur10e.home
    tau = model.chain(ur10e).inverse_dynamics(q, v, vdot) + model.friction.feedforward.torque(v)
    return Recording(t=20.0 + t, q=q, v=v, current=ur10e.motor_current(tau), source="")


def wrong(readings):
    """Valid readings beyond what they state."""
    return [r for r in readings if r.valid and (np.abs(r.wrench) > MOST_SD * r.sd).any()]


def test_without_a_fault_nothing_is_wrong(ur10e, model, recording):
    live = LiveEstimator(ur10e, model, CONFIG)
    signals = zip(recording.t, recording.q, recording.v, recording.current, strict=True)
    out = [r for t, q, v, i in signals for r in live.take(Sample(float(t), float(t), q, v, i))]
    assert not wrong(out)
    assert np.mean([r.valid for r in out]) > 0.9


def spoilt(samples, kind, at, rng):
    """The samples with one fault from number `at` on."""
    out = list(samples)
    length = rng.randint(1, 60)
    if kind == "doubled":
        out[at:at] = out[at - 1 : at]
    elif kind == "disordered":
        j = at + rng.randint(1, 5)
        out[at], out[j] = out[j], out[at]
    elif kind == "lost":
        del out[at : at + length]
    elif kind == "late":
        by = rng.uniform(0.06, 0.5)
        out[at:] = [
            replace(s, received=s.received + by * (k < length)) for k, s in enumerate(out[at:])
        ]
    elif kind == "clock":
        by = rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-0.5, 6.0)
        out[at:] = [replace(s, t=s.t + by) for s in out[at:]]
    elif kind == "absurd":
        bad = rng.choice([np.nan, np.inf, -np.inf, 1e300, 1e9, -50.0])
        field, joint = rng.choice(["t", "q", "v", "effort"]), rng.randrange(6)
        if field == "t":
            out[at] = replace(out[at], t=bad)
        else:
            values = getattr(out[at], field).copy()
            values[joint] = bad
            out[at] = replace(out[at], **{field: values})
    else:
        out[at : at + length] = [
            replace(s, running=False, effort=0.0 * s.effort) for s in out[at : at + length]
        ]
    return out


KINDS = ("doubled", "disordered", "lost", "late", "clock", "absurd", "stopped")


def check_faults(robot, model, recording, count):
    rng = random.Random(7)
    samples = [
        Sample(float(t), 100.0 + float(t), q, v, i)
        for t, q, v, i in zip(recording.t, recording.q, recording.v, recording.current, strict=True)
    ]
    for number in range(count):
        kind = KINDS[number % len(KINDS)]
        begin, at = rng.randrange(0, 1800), rng.randrange(1, 350)
        live = LiveEstimator(robot, model, CONFIG)
        out = [
            item
            for sample in spoilt(samples[begin : begin + 1100], kind, at, rng)
            for item in live.take(sample)
        ]
        readings = [item for item in out if isinstance(item, Reading)]
        assert not wrong(readings), (number, kind)
        for r in readings:
            assert np.isfinite(r.row[14:]).all(), (number, kind)  # the condition number may be inf
            assert not (r.valid and not np.isfinite(r.row).all()), (number, kind)
        settled = 0.2 + live.estimator.observer.settling_time
        assert settled < 1.2
        assert readings[-1].valid, (number, kind)
        if kind in ("clock", "stopped", "late"):
            assert any(isinstance(item, StreamEvent) for item in out), (number, kind)


def test_faults_at_random_moments(ur10e, model, recording):
    check_faults(ur10e, model, recording, 42)


@pytest.mark.slow
def test_a_thousand_faults_of_each_kind(ur10e, model, recording):
    check_faults(ur10e, model, recording, 1000 * len(KINDS))


class Mischief:
    """What comes between a controller and its reader, at random moments."""

    def __init__(self, seed):
        self.rng = random.Random(seed)
        self.held = None
        self.kinds = set()

    def __call__(self, count, data):
        if self.held is not None:
            held, self.held = self.held, None
            return (data, held)  # in the wrong order
        if count > 2200 or self.rng.random() > 0.01:
            return (data,)
        kind = self.rng.choice(["lost", "twice", "swap", "cut", "recipe", "garbage", "end", "wait"])
        self.kinds.add(kind)
        if kind == "lost":
            return ()
        if kind == "twice":
            return (data, data)
        if kind == "swap":
            self.held = data
            return ()
        if kind == "cut":
            k = self.rng.randrange(len(data))
            return (data[:k], data[k:])
        if kind == "recipe":
            return (packet(PacketType.DATA, b"\x63" + data[4:]), data)
        if kind == "garbage":
            return (self.rng.randbytes(self.rng.randrange(1, 60)), data)
        if kind == "wait":
            time.sleep(0.12)
            return (data,)
        raise ConnectionAbortedError


@pytest.mark.parametrize("seed", range(2))
def test_a_stormy_connection_reads_nothing_wrong(ur10e, model, recording, seed):
    mischief = Mischief(seed)
    readings, events, came = [], [], []

    def emit(item):
        if isinstance(item, Reading):
            readings.append(item)
            came.append(time.monotonic())
        else:
            events.append(item)

    with RtdeController([recording], port=0, tamper=mischief) as controller:
        source = open_source(f"rtde://127.0.0.1:{controller.port}", ur10e)
        live = LiveEstimator(ur10e, model, CONFIG, source.step, source.rate)
        end = time.monotonic() + 30.0

        def go_on():
            done = controller.ended.is_set() and time.monotonic() - came[-1] > 0.3
            return not done and time.monotonic() < end

        read_stream(source, live, emit, go_on=go_on)
        source.close()
    assert controller.ended.is_set()
    assert len(mischief.kinds) >= 5
    assert not wrong(readings)
    rows = {t: k for k, t in enumerate(recording.t.tolist())}
    fresh = [r for r in readings if r.t in rows and r.valid]
    assert all(np.array_equal(r.q, recording.q[rows[r.t]]) for r in fresh)
    # The storm ends 1.6 s before the recording does: then all is well again, until it is over.
    last = [r for r in readings if r.t > recording.t[-1] - 0.3 and r.t < recording.t[-1]]
    assert last
    assert any(r.valid for r in last)
    assert not readings[-1].valid  # silence
    kinds = {event.kind for event in events}
    assert {EventKind.LOST, EventKind.GARBAGE} & kinds
    assert EventKind.SILENT in kinds
