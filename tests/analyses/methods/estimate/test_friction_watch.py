"""Friction that has drifted is told from contact-free stretches of what the observer reads."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import torque_error
from scipy.signal import lfilter

from wrenchsight.analyses.methods.estimate.estimate_config import LARGEST_DRIFT
from wrenchsight.analyses.methods.estimate.friction_watch import FrictionWatch
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction
from wrenchsight.models.identification.identified_model import (
    IdentifiedModel,
    LogSource,
    Provenance,
)

T, ROWS, K_0 = 0.01, 4000, 20.0
KEEP = np.exp(-K_0 * T)


@pytest.fixture(scope="module")
def model(sts):
    one = np.ones(6)
    friction = SemiParametricFriction(CoulombViscous(5.0 * one, 10.0 * one, 0.0 * one))
    nominal = IdentifiedModel.nominal(sts)
    return replace(
        nominal,
        friction=friction,
        residual_covariance=0.25 * np.eye(6),
        provenance=Provenance(logs=[LogSource(name="a.csv")]),
    )


def signals(sts, seed=0):
    rng = np.random.default_rng(seed)
    t = T * np.arange(ROWS)
    phase, rate = rng.uniform(0.0, 6.0, 6), rng.uniform(0.8, 2.0, 6)
    q = sts.home + 0.3 * np.sin(rate * t[:, None] + phase)
    v = 0.3 * rate * np.cos(rate * t[:, None] + phase)
    noise = 0.2 * lfilter([1.0], [1.0, -0.98], rng.normal(size=(ROWS, 6)), axis=0)
    return t, q, v, noise * np.sqrt(1.0 - 0.98**2)


def watched(model, sts, t, q, v, tau_ext, free, cuts=(ROWS,)):
    watch = FrictionWatch(model, model.chain(sts), np.full(6, K_0), T)
    begin = 0
    for end in cuts:
        part = slice(begin, end)
        known = np.ones(end - begin, bool)
        watch.add(t[part], q[part], v[part], tau_ext[part], known, free[part])
        begin = end
    return watch


def drifted(v, noise, joint, viscous):
    tau_ext = noise.copy()
    tau_ext[:, joint] -= lfilter([1.0 - KEEP], [1.0, -KEEP], viscous * v[:, joint])
    return tau_ext


def test_no_word_where_friction_is_the_models(sts, model):
    free = np.ones(ROWS, bool)
    for seed in range(5):
        t, q, v, noise = signals(sts, seed)
        watch = watched(model, sts, t, q, v, noise, free)
        assert watch.sentences("log.csv", "r", "model.yaml") == []


def test_a_long_rest_neither_hides_a_change_nor_adds_to_it(sts, model):
    """Afterwards all joints rest in their stiction, their velocities a trace of noise."""
    t, q, v, noise = signals(sts)
    sliding = np.sign(v[:, 2]) + 6.0 * v[:, 2]
    tau_ext = noise.copy()
    tau_ext[:, 2] -= lfilter([1.0 - KEEP], [1.0, -KEEP], sliding)
    free = np.ones(ROWS, bool)
    alone = watched(model, sts, t, q, v, tau_ext, free).drifts()
    chatter = 1e-4 * np.random.default_rng(1).choice([-1.0, 1.0], (2 * ROWS, 6))
    log = watched(
        model,
        sts,
        T * np.arange(3 * ROWS),
        np.vstack([q, np.tile(q[-1], (2 * ROWS, 1))]),
        np.vstack([v, chatter]),
        np.vstack([tau_ext, np.full((2 * ROWS, 6), 2.0)]),
        np.ones(3 * ROWS, bool),
        (3 * ROWS,),
    )
    (found,) = log.disagreements()
    assert found.joint == 2
    # 5 %: what rests hold tells a little of the offset, and so of the two others.
    assert log.drifts()[2] == pytest.approx(alone[2], rel=0.05)
    assert log.drift() == pytest.approx(log.drifts()[2], rel=1e-9)


@pytest.mark.parametrize("cuts", [(ROWS,), (1, 700, 703, ROWS)])
def test_more_viscous_friction_is_named_with_the_command_to_run(sts, model, cuts):
    t, q, v, noise = signals(sts)
    tau_ext = drifted(v, noise, 2, 6.0)
    free = np.ones(ROWS, bool)
    watch = watched(model, sts, t + 100.0, q, v, tau_ext, free, cuts)
    (found,) = watch.disagreements()
    assert (found.joint, found.term) == (2, "viscous")
    assert found.change == pytest.approx(6.0, rel=0.15)
    lines = watch.sentences("log.csv", "r", "model.yaml")
    assert "friction of joint_3 differs from the model" in lines[0]
    command = "wrenchsight identify log.csv --robot r --refresh model.yaml --out refreshed"
    assert lines[1] == f"friction of today: {command}"
    assert watch.sentences("log.csv", "r", None) == []
    # On the log that the model was fitted on nothing has drifted, and nothing is to be refreshed.
    [own] = watch.sentences("log.csv", "r", "model.yaml", fitted=True)
    assert "was fitted on this log, and its friction law does not hold for" in own
    assert "--friction best" in own
    assert "refresh" not in own


def test_the_drift_for_the_band_is_what_the_stretches_show(sts, model):
    t, q, v, noise = signals(sts)
    error = torque_error(correlation_time=1.0, fitted_speed=1.0, fitted_load=1.0, K_0=K_0)
    known = replace(model, torque_error=error)
    free = np.ones(ROWS, bool)
    watch = watched(known, sts, t, q, v, drifted(v, noise, 2, 6.0), free)
    assert watch.drift() == pytest.approx(0.6, rel=0.15)  # 6 of 10 N m s/rad
    np.testing.assert_allclose(watch.drifts()[2], watch.drift(), rtol=1e-9)
    assert np.delete(watch.drifts(), 2).max() < 0.2  # what noise looks like, 1.4 se of it
    assert "allows for" in watch.sentences("log.csv", "r", "m.yaml", watch.drifts())[-1]
    # A joint that hardly moves may be off by any share of its viscous torque: it is not named.
    huge = np.array([0.1, 9.0, 0.6, 0.1, 0.1, 0.1])
    still = np.array([1.0, 1e-4, 1.0, 1.0, 1.0, 1.0])
    quiet = watched(known, sts, t, q, v * still, drifted(v * still, noise, 2, 6.0), free)
    *_, line = quiet.sentences("log.csv", "r", "m.yaml", huge)
    assert "joint_2" not in line
    assert "joint_3 by 60 %" in line
    *_, last = watch.sentences("log.csv", "r", "model.yaml")
    assert last.startswith("until then the stated band is too narrow: --drift 0.")
    assert watched(known, sts, t, q, v, noise, free).drift() is None
    assert watched(known, sts, t, q, v, noise, free).drifts() is None


def test_no_band_allows_for_more_drift_than_estimate_takes(sts, model):
    """15 times the model's viscous friction is another arm's."""
    t, q, v, noise = signals(sts)
    watch = watched(model, sts, t, q, v, drifted(v, noise, 2, 150.0), np.ones(ROWS, bool))
    assert watch.drift() > LARGEST_DRIFT
    assert watch.drifts()[2] == LARGEST_DRIFT == watch.drifts().max()


def test_a_contact_is_left_out_and_the_part_without_it_is_offered(sts, model):
    t, q, v, noise = signals(sts)
    tau_ext = drifted(v, noise, 2, 6.0)
    tau_ext[:1000] += 60.0
    free = np.ones(ROWS, bool)
    free[:1000] = False
    for cuts in ((ROWS,), (900, 1020, 2500, ROWS)):
        watch = watched(model, sts, t + 100.0, q, v, tau_ext, free, cuts)
        (found,) = watch.disagreements()
        assert found.change == pytest.approx(6.0, rel=0.15)
        # Half a second away from the contact, to the end of the log.
        command = watch.sentences("log.csv", "r", "model.yaml")[-1]
        assert "--part 10.5,39.9 " in command or "--part 10.6,39.9 " in command


def test_a_model_that_no_log_stands_behind_is_not_judged(sts, model):
    t, q, v, noise = signals(sts)
    assumed = replace(model, provenance=Provenance())
    watch = watched(assumed, sts, t, q, v, drifted(v, noise, 1, 9.0), np.ones(ROWS, bool))
    assert watch.sentences("log.csv", "r", "model.yaml") == []


def test_an_empty_log_says_nothing(sts, model):
    watch = FrictionWatch(model, model.chain(sts), None, T)
    assert watch.disagreements() == []
