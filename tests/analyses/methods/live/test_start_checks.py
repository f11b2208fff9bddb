"""Mistakes that a stream's first seconds show."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import harmonic_motion

from wrenchsight.analyses.methods.live.start_checks import CHECK_TIME, StartChecks
from wrenchsight.analyses.methods.live.watch_config import WatchConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveEstimator
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import EventKind, Sample

H = 0.01
g = 9.81


pytestmark = pytest.mark.usefixtures("one_thread")  # samples come one by one


@pytest.fixture(scope="module")
def model(ur10e):
    return replace(IdentifiedModel.nominal(ur10e), residual_covariance=0.3**2 * np.eye(6))


def samples(robot, model, mass=0.0, gravity=None, more=None):
    t = H * np.arange(round((CHECK_TIME + 1.5) / H))
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


def said(robot, model, stream, config=None):
    live = LiveEstimator(robot, model)
    checks = StartChecks(robot, model, config or WatchConfig())
    events = []
    for s in stream:
        event = checks.take(s, live)
        events += [event] if event is not None else []
        for item in live.take(s):
            if isinstance(item, Reading):
                checks.add(item)
    return live, events


def test_what_agrees_is_said_once(ur10e, model):
    live, (event,) = said(ur10e, model, samples(ur10e, model))
    assert event.kind is EventKind.CHECK
    assert event.text.endswith("agree with the model")
    assert not live.contradicted


def changed(stream, change):
    return [replace(s, **change(s)) for s in stream]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda s: {"effort": s.effort * 11.0}, "N m"),  # torque given as current
        (lambda s: {"effort": -s.effort}, "turned sign"),
        (lambda s: {"q": np.degrees(s.q)}, "rad"),
        (lambda s: {"v": np.degrees(s.v)}, "deg"),
        (lambda s: {"effort": s.effort[[0, 3, 2, 1, 4, 5]]}, "shoulder_lift_joint and wrist_1"),
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


def test_a_load_that_nobody_told_is_said_and_read(ur10e, model):
    stream = samples(ur10e, model, mass=2.0, more={"payload": np.array([2.0])})
    live, (event,) = said(ur10e, model, stream)
    assert event.kind is EventKind.CHECK
    assert "2.0" in event.text
    assert "the controller states a payload of 2.00 kg" in event.text
    assert not live.contradicted


def test_torques_per_ampere_are_held_against_the_controllers_own(ur10e, model):
    current = np.full(6, 2.0)
    gains = ur10e.torque_per_ampere * [1.0, 1.0, 1.2, 1.0, 1.0, 1.0]
    more = {"target_current": current, "target_moment": gains * current}
    _, (event,) = said(ur10e, model, samples(ur10e, model, more=more))
    assert "elbow_joint 11.8 (robot.yaml: 9.84)" in event.text
    assert "shoulder" not in event.text


def test_signs_may_be_accepted(ur10e, model):
    # A joint's drive that counts the other way.
    def change(s):
        effort = s.effort.copy()
        effort[1] = -effort[1]
        return {"effort": effort}

    stream = changed(samples(ur10e, model), change)
    _, events = said(ur10e, model, stream)
    assert events[0].kind is EventKind.CONTRADICTION
    assert "shoulder_lift_joint" in events[0].text
    _, events = said(ur10e, model, stream, WatchConfig(accept_signs=True))
    assert not any("sign" in event.text for event in events)


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
