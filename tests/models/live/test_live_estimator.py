"""Streams that are late, broken or out of order; what they read is held against the plain chain."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import free_motion, knowing_model, sample_torque_error

from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveConfig, LiveEstimator
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import EventKind, Sample, StreamEvent
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig

H = 0.002
CONFIG = LiveConfig(WrenchEstimatorConfig(MomentumObserverConfig(time_step=H)))


pytestmark = pytest.mark.usefixtures("one_thread")  # samples come one by one


@pytest.fixture(scope="module")
def model(ur10e):
    return knowing_model(ur10e, 3.0, 5.0)


@pytest.fixture(scope="module")
def samples(ur10e, model):
    """Two seconds without contact."""
    t = H * np.arange(1000)
    q, v, tau = free_motion(ur10e, model, t)
    current = ur10e.motor_current(tau)
    return [Sample(100.0 + t[k], 5.0 + t[k], q[k], v[k], current[k]) for k in range(len(t))]


def taken(live, samples):
    out = [item for sample in samples for item in live.take(sample)]
    events = [item for item in out if isinstance(item, StreamEvent)]
    return [item for item in out if isinstance(item, Reading)], events


def kinds(events):
    return {event.kind for event in events}


def test_a_stream_in_order_reads_as_the_estimator_does(ur10e, model, samples):
    readings, events = taken(LiveEstimator(ur10e, model, CONFIG), samples)
    assert not events
    by = WrenchEstimator(ur10e, model, replace(CONFIG.estimator, position_resolution=[1e-4] * 6))
    q, v, current = (np.array([getattr(s, n) for s in samples]) for n in ("q", "v", "effort"))
    batch = by.run(by.initial_state(), q, v, current)
    # The grid's interpolation on steps that are off by rounding is the identity to 1e-12.
    wrench = np.array([reading.wrench for reading in readings])
    np.testing.assert_allclose(wrench, batch.wrench, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal([reading.valid for reading in readings], batch.valid)
    assert batch.valid.any()


def test_torque_reads_as_the_current_that_it_takes(ur10e, model, samples):
    turned = [
        replace(s, effort=ur10e.joint_torque(s.effort), is_torque=True) for s in samples[:200]
    ]
    readings, _ = taken(LiveEstimator(ur10e, model, CONFIG), turned)
    plain, _ = taken(LiveEstimator(ur10e, model, CONFIG), samples[:200])
    wrench, expected = (np.array([r.wrench for r in part]) for part in (readings, plain))
    np.testing.assert_allclose(wrench, expected, atol=1e-9)


@pytest.mark.parametrize(("stated", "expected"), [(H, H), (None, H), (0.008, H)])
def test_the_step_is_that_of_the_stream(ur10e, model, samples, stated, expected):
    live = LiveEstimator(ur10e, model, LiveConfig(late=10.0), step=stated)
    readings, _ = taken(live, samples[:300])
    assert live.step == pytest.approx(expected, rel=1e-6)
    assert len(readings) == 300  # none of those that were waited for is lost


def test_doubled_and_disordered_samples_are_left_out(ur10e, model, samples):
    mixed = list(samples)
    mixed.insert(500, samples[499])
    mixed[700], mixed[701] = mixed[701], mixed[700]
    live = LiveEstimator(ur10e, model, CONFIG)
    readings, events = taken(live, mixed)
    assert kinds(events) == {EventKind.DOUBLED, EventKind.GAP, EventKind.DISORDERED}
    plain, _ = taken(LiveEstimator(ur10e, model, CONFIG), samples)
    assert len(readings) == len(plain)
    # The sample that is left out is bridged, and said to be.
    (bridged,) = [k for k, reading in enumerate(readings) if reading.dropout]
    assert bridged in (699, 700)
    assert not readings[bridged].valid


@pytest.mark.parametrize(("jump", "kind"), [(30.0, EventKind.CLOCK), (-30.0, EventKind.CLOCK)])
def test_a_clock_that_jumps_begins_anew(ur10e, model, samples, jump, kind):
    jumped = samples[:500] + [replace(s, t=s.t + jump) for s in samples[500:]]
    readings, events = taken(LiveEstimator(ur10e, model, CONFIG), jumped)
    assert kinds(events) - {EventKind.DISORDERED} == {kind}
    after = [r for r in readings if abs(r.t - samples[0].t - jump) < 10.0]
    assert not after[0].valid
    assert after[-1].valid


def test_a_gap_restarts_the_estimator_and_is_reported(ur10e, model, samples):
    readings, events = taken(LiveEstimator(ur10e, model, CONFIG), samples[:500] + samples[700:])
    assert kinds(events) == {EventKind.GAP}
    assert not any(0.9985 < r.t - 100.0 < 1.3985 for r in readings)
    assert not next(r for r in readings if r.t > 101.39).valid


def test_a_robot_that_stops_is_not_read(ur10e, model, samples):
    stopped = [
        replace(s, running=not 500 <= k < 600, state="protective stop")
        for k, s in enumerate(samples)
    ]
    readings, events = taken(LiveEstimator(ur10e, model, CONFIG), stopped)
    assert [event.kind for event in events] == [EventKind.STOPPED, EventKind.RUNNING]
    assert "protective stop" in events[0].text
    assert not any(r.valid for r in readings if 100.998 < r.t < 101.2)
    assert readings[-1].valid


def test_late_samples_are_read_but_not_valid(ur10e, model, samples):
    late = [replace(s, received=s.received + 0.3 * (500 <= k < 800)) for k, s in enumerate(samples)]
    readings, events = taken(LiveEstimator(ur10e, model, CONFIG), late)
    assert kinds(events) == {EventKind.LATE, EventKind.ON_TIME}
    assert not any(r.valid for r in readings[500:800])
    assert readings[-1].valid


def test_a_payload_is_zeroed(ur10e):
    model = replace(IdentifiedModel.nominal(ur10e), torque_error=sample_torque_error())
    q, zero = np.add(ur10e.home, [0.0, 0.0, 0.0, 0.0, 0.5, 0.0]), np.zeros(6)
    J = ur10e.chain.terms(q, zero).J
    weight = J.T @ [0.0, 0.0, 0.0, 0.0, 0.0, -1.5 * 9.81]
    current = ur10e.motor_current(ur10e.chain.gravity_torque(q[None])[0] - weight)
    rng = np.random.default_rng(6)
    still = [
        Sample(H * k, H * k, q + 1e-6 * rng.normal(size=6), zero, current) for k in range(2000)
    ]
    plain, _ = taken(LiveEstimator(ur10e, model, CONFIG), still)
    assert plain[-1].wrench[5] == pytest.approx(-1.5 * 9.81, abs=3.0)
    readings, events = taken(LiveEstimator(ur10e, model, replace(CONFIG, zero_s=3.0)), still)
    assert [event.kind for event in events] == [EventKind.ZERO, EventKind.ZERO]
    assert "1 posture" in events[1].text
    assert not any(reading.valid for reading in readings[:1499])
    assert np.abs(readings[-1].wrench[3:]).max() < 2.0


def test_silence_ends_validity_once(ur10e, model, samples):
    live = LiveEstimator(ur10e, model, CONFIG)
    readings, _ = taken(live, samples)
    assert readings[-1].valid
    last = samples[-1].received
    assert live.idle(last + 0.01) == []
    event, reading = live.idle(last + 0.2)
    assert event.kind is EventKind.SILENT
    assert not reading.valid
    np.testing.assert_array_equal(reading.wrench, readings[-1].wrench)
    assert live.idle(last + 0.4) == []


def test_an_interruption_ends_validity_and_settles_anew(ur10e, model, samples):
    live = LiveEstimator(ur10e, model, CONFIG)
    taken(live, samples[:500])
    (reading,) = live.interrupt(7.0)
    assert not reading.valid
    readings, _ = taken(live, samples[500:])
    assert not readings[0].valid
    assert readings[-1].valid


def test_readings_never_contain_nan(ur10e, model, samples):
    rng = np.random.default_rng(4)
    spoilt = []
    for s in samples:
        q, v, effort = s.q.copy(), s.v.copy(), s.effort.copy()
        if rng.uniform() < 0.1:
            rng.choice([q, v, effort])
            for part in (q, v, effort):
                part[rng.integers(6)] = rng.choice([np.nan, np.inf, -np.inf, 1e300])
        t = s.t if rng.uniform() > 0.02 else rng.choice([np.nan, np.inf, -np.inf])
        spoilt.append(replace(s, t=float(t), q=q, v=v, effort=effort))
    readings, events = taken(LiveEstimator(ur10e, model, CONFIG), spoilt)
    assert EventKind.GARBAGE in kinds(events)
    for reading in readings:
        assert np.isfinite(reading.wrench).all()
        assert not (reading.valid and (reading.dropout or reading.fault))


def test_a_sample_of_another_arm_is_left_out(ur10e, model, samples):
    live = LiveEstimator(ur10e, model, CONFIG)
    (event,) = live.take(replace(samples[0], q=np.zeros(7)))
    assert event.kind is EventKind.RECIPE


def test_the_encoders_step_is_found_in_the_stream(ur10e, model, samples):
    coarse = [replace(s, q=np.round(s.q / 4e-4) * 4e-4) for s in samples]
    live = LiveEstimator(ur10e, model, CONFIG)
    readings, events = taken(live, coarse)
    assert [event.kind for event in events] == [EventKind.CHECK]
    assert "0.4 mrad" in events[0].text
    np.testing.assert_allclose(live.estimator.config.position_resolution, 4e-4, rtol=1e-9)
    assert len(readings) == len(coarse)
    assert readings[-1].valid
    stated = replace(CONFIG.estimator, position_resolution=[4e-4] * 6)
    with_resolution, none = taken(LiveEstimator(ur10e, model, LiveConfig(stated)), coarse)
    assert not none
    # What was read before settles.
    np.testing.assert_allclose(readings[-1].wrench, with_resolution[-1].wrench, atol=1e-3)
