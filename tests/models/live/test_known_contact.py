"""A tool that presses along a known axis, read sample by sample."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import free_motion, knowing_model

from wrenchsight.models.estimation.contact_filter import ContactConfig
from wrenchsight.models.estimation.contact_reading import ContactReader
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.live.live_estimator import LiveConfig, LiveEstimator
from wrenchsight.models.live.samples import Sample
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig

H, BLOCK, FORCE = 0.002, 10, 40.0
CONTACT = ContactConfig(axis="tool_z", lag=0.0)
ESTIMATOR = WrenchEstimatorConfig(
    MomentumObserverConfig(time_step=H, torque_samples="trapezoidal"),
    position_resolution=[1e-9] * 6,
    check_samples=False,
)


@pytest.fixture(scope="module")
def pressed(ur10e):
    """A model, and two seconds with FORCE against E along tool z from the first second on."""
    model = knowing_model(ur10e, 3.0, 5.0)
    t = H * np.arange(1000)
    q, v, tau = free_motion(ur10e, model, t, 0.1)
    R_WE, _ = ur10e.chain.pose(q)
    force = -np.where(t < 1.0, 0.0, FORCE)[:, None] * R_WE[:, :, 2]
    tau -= np.einsum("kaj,ka->kj", ur10e.chain.jacobian(q)[:, 3:], force)
    return model, t, q, v, ur10e.motor_current(tau)


def test_the_reading_is_the_filter_s_of_the_last_whole_block(ur10e, pressed):
    model, t, q, v, current = pressed
    live = LiveEstimator(ur10e, model, LiveConfig(ESTIMATOR, contact=CONTACT))
    samples = [Sample(t[k], t[k], q[k], v[k], current[k]) for k in range(len(t))]
    readings = [reading for sample in samples for reading in live.take(sample)]

    by = WrenchEstimator(ur10e, model, ESTIMATOR)
    batch = by.run(by.initial_state(), q, v, current)
    reader = ContactReader(ur10e, by.observer.pole, H, CONTACT)
    whole = reader.take(q, v, ur10e.joint_torque(current), batch.fresh, batch)
    for block in range(1, len(t) // BLOCK):
        end = block * BLOCK - 1
        for k in (end, end + BLOCK - 1):
            np.testing.assert_allclose(readings[k].wrench, whole.wrench[end], rtol=1e-9, atol=1e-9)
            assert readings[k].valid == whole.valid[end]
    assert not any(reading.valid for reading in readings[: BLOCK - 1])

    R_WE, _ = ur10e.chain.pose(q)
    pressing = t > 1.1
    n_W = R_WE[pressing, :, 2]
    in_contact = [reading for reading, k in zip(readings, pressing, strict=True) if k]
    press = -np.array([r.wrench[3:] @ n for r, n in zip(in_contact, n_W, strict=True)])
    sd = np.sqrt([n @ r.covariance[3:, 3:] @ n for r, n in zip(in_contact, n_W, strict=True)])
    error = np.abs(press - FORCE)
    assert np.mean(error < 1.96 * sd) >= 0.95 and (error < 2.5 * sd).all()
    assert sd.max() < 0.5 * FORCE


def test_a_stream_that_was_interrupted_begins_anew(ur10e, pressed):
    model, t, q, v, current = pressed
    live = LiveEstimator(ur10e, model, LiveConfig(ESTIMATOR, contact=replace(CONTACT)))
    for k in range(800):
        (reading,) = live.take(Sample(t[k], t[k], q[k], v[k], current[k]))
    assert reading.valid
    (reading,) = live.interrupt(t[800])
    assert not reading.valid
    (reading,) = live.take(Sample(t[900], t[900], q[900], v[900], current[900]))
    assert not reading.valid
