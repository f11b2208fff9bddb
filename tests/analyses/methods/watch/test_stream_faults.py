"""Faults at random moments: nothing wrong is valid, readings are back in time, none is lost.

Nothing touches the arm, and the model is the arm's own: what is read is error, and a valid reading
beyond MOST_SD of its stated deviation is wrong.
"""

import random
import time
from dataclasses import dataclass, replace

import numpy as np
import pytest
from sample_models import free_motion, sample_torque_error

from wrenchsight.analyses.methods.watch.reader_process import read_stream
from wrenchsight.analyses.methods.watch.rtde_controller import RtdeController
from wrenchsight.analyses.methods.watch.sources import open_source
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveConfig, LiveEstimator
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.rtde import PacketType, packet
from wrenchsight.models.live.samples import EventKind, Sample
from wrenchsight.models.live.stream_order import MIN_LATE_SAMPLES, SAY_AGAIN
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.recording import Recording

H = 0.002
MOST_SD = 3.0
BACK = 1.0  # s, and the settling time
STEADY = 50  # valid readings in a row: the reading is back
CHAIN = 25  # faults of one stream
CONFIG = LiveConfig(WrenchEstimatorConfig(MomentumObserverConfig(time_step=H)))


pytestmark = [pytest.mark.usefixtures("one_thread"), pytest.mark.long]  # samples come one by one


@pytest.fixture(scope="module")
def model(ur10e):
    """With viscous friction, which repeats exactly."""
    nothing = np.zeros(6)
    friction = SemiParametricFriction(CoulombViscous(nothing, nothing + 5.0, nothing))
    model = IdentifiedModel.nominal(ur10e)
    return replace(model, friction=friction, torque_error=sample_torque_error())


@pytest.fixture(scope="module")
def recording(ur10e, model):
    return motion(ur10e, model, 3000)


@pytest.fixture(scope="module")
def long_recording(ur10e, model):
    return motion(ur10e, model, 20000)


def motion(ur10e, model, count):
    t = H * np.arange(count)
    q, v, tau = free_motion(ur10e, model, t)
    return Recording(t=20.0 + t, q=q, v=v, current=ur10e.motor_current(tau), source="")


def wrong(readings):
    """Valid readings beyond what they state."""
    return [r for r in readings if r.valid and not share_of_band(r) <= MOST_SD]


def share_of_band(reading):
    """What is read, in its own standard deviations."""
    return np.abs(reading.wrench / reading.sd).max()


def test_without_a_fault_nothing_is_wrong(ur10e, model, recording):
    live = LiveEstimator(ur10e, model, CONFIG)
    signals = zip(recording.t, recording.q, recording.v, recording.current, strict=True)
    out = [r for t, q, v, i in signals for r in live.take(Sample(float(t), float(t), q, v, i))]
    assert not wrong(out)
    assert np.mean([r.valid for r in out]) > 0.9


def spoilt(samples, kind, at, rng):
    """The samples with one fault from number `at` on, and the first number that it leaves alone."""
    out = list(samples)
    length, last = rng.randint(1, 60), at + 1
    if kind == "doubled":
        out[at:at] = out[at - 1 : at]
    elif kind == "disordered":
        last += rng.randint(1, 5)
        out[at], out[last - 1] = out[last - 1], out[at]
    elif kind == "lost":
        last = at + length
        del out[at:last]
    elif kind == "late":
        by = rng.uniform(0.06, 0.5)
        held = out[at + length - 1].received + by  # none overtakes another
        last = at + next(k for k, s in enumerate(out[at:]) if s.received > held)
        out[at:last] = [replace(s, received=min(s.received + by, held)) for s in out[at:last]]
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
        last = at + length
        out[at:last] = [replace(s, running=False, effort=0.0 * s.effort) for s in out[at:last]]
    return out, last


KINDS = ("doubled", "disordered", "lost", "late", "clock", "absurd", "stopped")
ALWAYS_SAID = ("clock", "stopped", "late")  # but once a second at most
LONGEST_FAULT = 0.7  # s


@dataclass
class Found:
    """Of all faults of one kind.

    Attributes:
        faults: how many there were.
        largest: in its own standard deviations, of what was valid.
        back: s, the longest from a fault's end to readings that stay valid.
        lost: samples that no fault touched, and of which there is no reading.
    """

    faults: int = 0
    largest: float = 0.0
    back: float = 0.0
    lost: int = 0


def check_faults(robot, model, recording, kind, count, seed=0):
    """One stream with that many faults, each some time after the last one is over."""
    rng = random.Random(f"{kind} {seed}")
    rows = (recording.t, recording.q, recording.v, recording.current)
    samples = [
        Sample(float(t), 100.0 + float(t), *signals) for t, *signals in zip(*rows, strict=True)
    ]
    live = LiveEstimator(robot, model, CONFIG)
    settling = live.estimator.observer.settling_time
    tail = round((BACK + settling) / H) + STEADY
    begin, shift, findings, last_report = rng.randrange(0, 1800), 0.0, Found(count), -np.inf
    for number in range(count):
        where = f"seed {seed}, fault {number} ({kind})"
        at = rng.randrange(1, 350)
        sound_samples = [
            replace(s, t=s.t + shift) for s in samples[begin : begin + at + 400 + tail]
        ]
        stream, last = spoilt(sound_samples, kind, at, rng)
        first = len(stream) - (
            len(sound_samples) - last
        )  # of the stream, that is as it should be again
        shift += stream[-1].t - sound_samples[-1].t
        over = max((s.received for s in stream[at:first]), default=sound_samples[last - 1].received)
        events, read, steady, since = [], [], 0, np.inf
        for fed, sample in enumerate(stream, 1):
            for item in live.take(sample):
                if not isinstance(item, Reading):
                    events.append(item)
                    continue
                assert not wrong([item]), (where, item.t, share_of_band(item))
                assert np.isfinite(item.row[14:]).all(), where  # the condition number may be inf
                read.append(item.t)
                steady = steady + 1 if item.valid and fed > first else 0
                if item.valid:
                    assert np.isfinite(item.row).all(), where
                    findings.largest = max(findings.largest, share_of_band(item))
                    since = item.received if steady == 1 else since
            if steady >= STEADY:
                break
        assert steady >= STEADY, f"{where}: not valid again"
        findings.back = max(findings.back, since - over)
        assert since - over <= BACK + settling, f"{where}: valid again after {since - over:.2f} s"
        clean = [*stream[:at], *stream[first:fed]]
        missing = sum(np.min(np.abs(np.array(read) - s.t)) > H / 4 for s in clean)
        # That a clock went back is known by the third sample.
        assert missing < MIN_LATE_SAMPLES, f"{where}: {missing} samples have no reading"
        findings.lost += missing
        last_report = events[-1].received if events else last_report
        assert kind not in ALWAYS_SAID or last_report > over - SAY_AGAIN - LONGEST_FAULT, where
        begin += fed - first + last
    return findings


@pytest.mark.parametrize("kind", KINDS)
def test_faults_at_random_moments(ur10e, model, long_recording, kind):
    check_faults(ur10e, model, long_recording, kind, 6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_thousand_faults_of_each_kind(ur10e, model, long_recording, kind):
    findings = [
        check_faults(ur10e, model, long_recording, kind, CHAIN, seed)
        for seed in range(1000 // CHAIN)
    ]
    print(
        f"{sum(one.faults for one in findings)} {kind}: largest valid "
        f"{max(one.largest for one in findings):.2f} sd, longest back "
        f"{max(one.back for one in findings):.3f} s, "
        f"{sum(one.lost for one in findings)} samples lost"
    )


STORM = 1800  # samples
# What is late is judged above: on a busy computer all comes late, and is rightly not valid.
STORM_CONFIG = replace(CONFIG, late=10.0)


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
        if count > STORM or self.rng.random() > 0.01:
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
        live = LiveEstimator(ur10e, model, STORM_CONFIG, source.step, source.rate)
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
    # The storm ends 2.4 s before the recording does: then all is well again, until it is over.
    last = [r for r in readings if r.t > recording.t[-1] - 0.3 and r.t < recording.t[-1]]
    assert last
    assert any(r.valid for r in last)
    assert not readings[-1].valid  # silence
    kinds = {event.kind for event in events}
    assert {EventKind.LOST, EventKind.GARBAGE} & kinds
    assert EventKind.SILENT in kinds
