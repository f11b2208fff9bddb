"""Mistakes that a stream's first seconds show."""

import itertools
import re
import time
from dataclasses import replace

import numpy as np
import pytest
from sample_models import harmonic_motion

from wrenchsight.analyses.methods.watch.load_search import LEAST_MASS
from wrenchsight.analyses.methods.watch.sources import open_source
from wrenchsight.analyses.methods.watch.start_checks import CHECK_TIME, StartChecks
from wrenchsight.analyses.methods.watch.watch_config import WatchConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveEstimator
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import EventKind, Sample
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

H = 0.01
g = 9.81


pytestmark = pytest.mark.usefixtures("one_thread")  # samples come one by one


@pytest.fixture(scope="module")
def model(ur10e):
    model = IdentifiedModel.nominal(ur10e)  # as if it were fitted: its masses are sure
    provenance = replace(model.provenance, logs=("free.csv",))
    return replace(model, residual_covariance=0.3**2 * np.eye(6), provenance=provenance)


def samples(robot, model, mass=0.0, gravity=None, more=None, seconds=CHECK_TIME + 1.5):
    t = H * np.arange(round(seconds / H))
    q, v, vdot = harmonic_motion(np.random.default_rng(2), t, [0.9, 1.7], 0.35)
    q += robot.home
    chain = model.chain(robot)
    if gravity is not None:
        chain = replace(chain, gravity=np.array(gravity))
    tau = chain.inverse_dynamics(q, v, vdot)
    tau -= np.einsum("kaj,a->kj", chain.jacobian(q)[:, 3:], [0.0, 0.0, -mass * g])
    tau += 0.2 * np.random.default_rng(1).normal(size=tau.shape)
    current = robot.motor_current(tau)
    return [
        Sample(50.0 + t[k], float(t[k]), q[k], v[k], current[k], more=more or {})
        for k in range(len(t))
    ]


def said(robot, model, stream, config=None, lacks_model=False):
    live = LiveEstimator(robot, model)
    live.lacks_model = lacks_model
    checks = StartChecks(robot, model, config or WatchConfig())
    events = []
    for s in stream:
        items = live.take(s)
        event = checks.take(s, live)
        events += [event] if event is not None else []
        for item in items:
            if isinstance(item, Reading):
                checks.add(item)
    return live, events


def test_agreement_is_reported_once(ur10e, model):
    live, (event,) = said(ur10e, model, samples(ur10e, model))
    assert event.kind is EventKind.CHECK
    assert event.text.endswith("agree with the model")
    assert not live.contradicted


_TORQUE_PER_AMPERE = Robot.load("ur10e").torque_per_ampere


def changed(stream, change):
    return [replace(s, **change(s)) for s in stream]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda s: {"effort": _TORQUE_PER_AMPERE * s.effort}, "N m in place of currents"),
        (lambda s: {"effort": -s.effort}, "opposite sign"),
        (lambda s: {"q": np.degrees(s.q)}, "rad"),
        (lambda s: {"v": np.degrees(s.v)}, "deg"),
        (lambda s: {"effort": s.effort[[0, 3, 2, 1, 4, 5]]}, "order [1, 4, 3, 2, 5, 6]"),
    ],
)
def test_a_contradiction_is_named_and_nothing_is_valid(ur10e, model, change, words):
    live, events = said(ur10e, model, changed(samples(ur10e, model), change))
    assert events[0].kind is EventKind.CONTRADICTION
    assert words in events[0].text
    assert "--no-check" in events[0].text
    assert live.contradicted


def test_a_tilted_base_is_named(ur10e, model):
    tilt = np.radians(12.0)
    gravity = [g * np.sin(tilt), 0.0, -g * np.cos(tilt)]
    live, events = said(ur10e, model, samples(ur10e, model, gravity=gravity))
    assert events[0].kind is EventKind.CONTRADICTION
    assert "gravity" in events[0].text
    assert live.contradicted


def texts(events):
    return [event.text for event in events]


def test_what_the_estimator_finds_impossible_is_no_contradiction(ur10e, model):
    """One check of each sample serves both."""
    stream = samples(ur10e, model)
    impossible = [stream[k].t for k in range(50, 500, 60)]
    for s in stream:
        if s.t in impossible:
            s.q[2] = 1e300
    live, events = said(ur10e, model, stream)
    assert list(live.impossible_times) == impossible
    assert not live.contradicted
    assert any(text.endswith("agree with the model") for text in texts(events))


def test_an_unmodelled_load_is_reported_with_its_error_and_still_read(ur10e, model):
    stream = samples(ur10e, model, mass=2.0, more={"payload": np.array([2.0])})
    live, events = said(ur10e, model, stream)
    assert {event.kind for event in events} == {EventKind.CHECK}
    agrees, payload, load = texts(events)
    assert agrees.endswith("agree with the model")
    assert payload.startswith("the controller states a payload of 2.00 kg, robot.yaml a tool of 0.")
    pattern = r"unmodelled load at the tool: (\S+) \+- (\S+) kg; identify it with `wrenchsight payl"
    mass, sd = map(float, re.match(pattern, load).groups())
    assert abs(mass - 2.0) < 3.0 * sd < 1.0
    assert not live.contradicted


def test_a_few_hundred_grams_are_not_worth_a_sentence(ur10e, model):
    model = replace(model, residual_covariance=0.02**2 * np.eye(6))  # which shows them surely
    _, events = said(ur10e, model, samples(ur10e, model, mass=LEAST_MASS - 0.1))
    assert not any("load" in text for text in texts(events))
    _, events = said(ur10e, model, samples(ur10e, model, mass=LEAST_MASS + 0.1))
    assert any("load" in text for text in texts(events))


def test_no_load_is_looked_for_where_it_is_taken_off_or_the_model_is_none(ur10e, model):
    stream = samples(ur10e, model, mass=2.0)
    config = WatchConfig()
    _, events = said(ur10e, model, stream, replace(config, live=replace(config.live, zero_s=1.0)))
    assert not any("load" in text for text in texts(events))
    _, events = said(ur10e, model, stream, lacks_model=True)  # as without --model
    assert not any("load" in text for text in texts(events))


@pytest.mark.long
def test_checks_in_the_background_report_the_same(ur10e, model):
    stream = samples(ur10e, model, mass=2.0)
    _, before = said(ur10e, model, stream)
    live = LiveEstimator(ur10e, model)
    checks = StartChecks(ur10e, model, WatchConfig(), in_background=True)
    events = []
    for sample in samples(ur10e, model, mass=2.0, seconds=40.0):
        items = live.take(sample)
        events.append(checks.take(sample, live))
        for item in items:
            checks.add(item)
        if sum(event is not None for event in events) == len(before):
            break
        if len(events) % 100 == 0:  # a second of the stream, in which a look may end
            time.sleep(1.0)
    checks.close()
    # Each is said once it is known, of what was known then.
    said_so = [event.text for event in events if event is not None]
    assert any(text.endswith("agree with the model") for text in said_so)
    assert any(text.startswith("unmodelled load at the tool: 2.") for text in said_so)
    assert len(said_so) == 2


def targets(robot, stream, ratio=1.0, friction=0.0):
    """The stream of a controller whose torques per ampere are `ratio` times robot.yaml's, with its
    targets; `friction` N m is in its target current while a joint moves."""
    q = np.array([s.q for s in stream])
    v = np.array([s.v for s in stream])
    torque = robot.chain.gravity_torque(q)
    current = (torque + friction * np.sign(v)) / (ratio * robot.torque_per_ampere)
    return [
        replace(s, more={"target_current": current[k], "target_moment": torque[k]})
        for k, s in enumerate(stream)
    ]


def resting(robot, model, seconds):
    """A stream whose joints rest for the last seconds, in a posture that loads joints 2 to 4."""
    moving = samples(robot, model)
    held = robot.home + np.array([0.0, -0.6, 0.9, 0.5, 0.0, 0.0])
    tau = model.chain(robot).gravity_torque(held[None])[0]
    effort = robot.motor_current(tau)
    last = moving[-1].t
    times = last + 5.0 + H * np.arange(round(seconds / H))  # it drives there unseen
    still = [Sample(float(t), float(t), held, np.zeros(6), effort) for t in times]
    return moving, still


def test_torques_per_ampere_wait_for_a_rest_under_gravity(ur10e, model):
    moving, still = resting(ur10e, model, 2.5)
    ratio = [1.0, 1.0, 1.1, 1.0, 1.0, 1.0]
    _, events = said(ur10e, model, targets(ur10e, moving, ratio, friction=9.0))
    assert not any("torque per ampere" in text for text in texts(events))
    _, events = said(ur10e, model, targets(ur10e, moving + still, ratio, friction=9.0))
    (text,) = [text for text in texts(events) if "torque per ampere" in text]
    stated = ur10e.torque_per_ampere[2]
    assert text.startswith(
        f"elbow_joint: the controller's torque per ampere is {1.1 * stated:.2f} +- 0.01 N m/A, "
        f"robot.yaml has {stated:.2f} (10 % off); correct torque_per_ampere in robot.yaml"
    )


def test_a_rest_across_two_looks_is_judged(ur10e, model):
    moving, still = resting(ur10e, model, 0.95)
    begin = moving[-1].t + H - still[0].t  # half a second after a look
    still = [replace(s, t=s.t + begin) for s in still]
    again = still[-1].t + H - moving[0].t
    stream = [*moving, *still, *(replace(s, t=s.t + again) for s in moving[:200])]
    _, events = said(ur10e, model, targets(ur10e, stream, 1.1, friction=9.0))
    assert any("torque per ampere" in text for text in texts(events))


def test_gains_that_agree_are_not_spoken_of_nor_those_of_unloaded_joints(ur10e, model):
    moving, still = resting(ur10e, model, 2.5)
    for ratio in (1.0, [1.3, 1.0, 1.0, 1.0, 1.0, 1.3], 1.02):
        _, events = said(ur10e, model, targets(ur10e, moving + still, ratio, friction=9.0))
        assert not any("torque per ampere" in text for text in texts(events))


def test_a_source_of_torques_has_no_gains(ur10e, model):
    moving, still = resting(ur10e, model, 2.5)
    stream = [
        replace(s, effort=ur10e.joint_torque(s.effort), is_torque=True)
        for s in targets(ur10e, moving + still, 1.2)
    ]
    _, events = said(ur10e, model, stream)
    assert texts(events)[0].endswith("agree with the model")
    assert not any("torque per ampere" in text for text in texts(events))


@pytest.mark.long
@pytest.mark.parametrize(
    ("log", "begins"),
    [("ur-20_01_22-joint_3", (0.0, 20.0)), ("ur-20_01_22-joint_2", (33.0,))],
)
def test_gains_of_a_recorded_controller(ur10e, model, data, log, begins):
    # From each of these seconds on a joint rests under gravity within 20 s.
    recording = read_recording(data(f"ur10e/{log}.csv"), robot=ur10e)
    current, torque = recording.extra["current_desired"], recording.extra["tau_desired"]
    since = recording.t - recording.t[0]
    for scale, begin in itertools.product((1.0, 1.1), begins):
        checks, live = StartChecks(ur10e, model, WatchConfig()), LiveEstimator(ur10e, model)
        events = []
        for k in np.flatnonzero((since >= begin) & (since < begin + 20.0)):
            more = {"target_current": current[k] / scale, "target_moment": torque[k]}
            signals = recording.q[k], recording.v[k], recording.current[k]
            events.append(checks.take(Sample(recording.t[k], 0.0, *signals, more=more), live))
        gains = [e.text for e in events if e is not None and "torque per ampere" in e.text]
        assert bool(gains) == (scale > 1.0)
        assert all("(10 % off)" in text for text in gains)


def test_a_replayed_log_hands_on_its_controllers_targets(ur10e, tmp_path):
    t = H * np.arange(50)
    q = np.tile(ur10e.home, (50, 1))
    extra = {"current_desired": np.arange(300.0).reshape(50, 6), "tau_desired": 2.0 * q, "x": t}
    log = Recording(t=t, q=q, v=0.0 * q, current=0.1 + 0.0 * q, source="", extra=extra)
    write_recording(log, tmp_path / "log.csv")
    source = open_source(f"replay://{tmp_path}/log.csv?rate=0", ur10e)
    items = [item for item in source.read(0.1) if isinstance(item, Sample)]
    assert len(items) == 50
    for name, signal in (("target_current", "current_desired"), ("target_moment", "tau_desired")):
        np.testing.assert_array_equal([item.more[name] for item in items], extra[signal])


def test_a_missing_model_is_reported(ur10e, model):
    _, events = said(ur10e, model, samples(ur10e, model)[:3], lacks_model=True)
    (text,) = texts(events)
    assert text.startswith("no --model")


def test_nothing_breaks_on_samples_that_are_none(ur10e, model):
    rng = np.random.default_rng(5)
    stream = []
    for s in samples(ur10e, model):
        q = s.q.copy()
        if rng.uniform() < 0.3:
            q[rng.integers(6)] = np.nan
        t = s.t if rng.uniform() < 0.9 else s.t - rng.uniform(0.0, 0.1)
        stream.append(replace(s, q=q, t=float(t)))
    live, events = said(ur10e, model, stream)
    assert not live.contradicted
    assert [event.kind for event in events] == [EventKind.CHECK]
