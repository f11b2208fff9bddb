"""Friction drift is found in contact-free stretches of what the observer reads."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import torque_error
from scipy.signal import lfilter

from wrenchsight.analyses.methods.estimate.estimate_config import LARGEST_DRIFT
from wrenchsight.analyses.methods.estimate.friction_monitor import FrictionMonitor
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
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


def monitored(model, sts, t, q, v, tau_ext, free, cuts=(ROWS,)):
    monitor = FrictionMonitor(model, model.chain(sts), np.full(6, K_0), T)
    begin = 0
    for end in cuts:
        part = slice(begin, end)
        is_usable = np.ones(end - begin, bool)
        monitor.add(t[part], q[part], v[part], tau_ext[part], is_usable, free[part])
        begin = end
    return monitor


def drifted(v, noise, joint, viscous):
    tau_ext = noise.copy()
    tau_ext[:, joint] -= lfilter([1.0 - KEEP], [1.0, -KEEP], viscous * v[:, joint])
    return tau_ext


def test_friction_as_the_model_has_it_gives_no_sentence(sts, model):
    free = np.ones(ROWS, bool)
    for seed in range(5):
        t, q, v, noise = signals(sts, seed)
        monitor = monitored(model, sts, t, q, v, noise, free)
        assert monitor.sentences("log.csv", "r", "model.yaml") == []


def test_a_long_rest_neither_hides_a_change_nor_adds_to_it(sts, model):
    """Afterwards all joints rest in their stiction, their velocities a trace of noise."""
    t, q, v, noise = signals(sts)
    sliding = np.sign(v[:, 2]) + 6.0 * v[:, 2]
    tau_ext = noise.copy()
    tau_ext[:, 2] -= lfilter([1.0 - KEEP], [1.0, -KEEP], sliding)
    free = np.ones(ROWS, bool)
    alone = monitored(model, sts, t, q, v, tau_ext, free).drifts()
    chatter = 1e-4 * np.random.default_rng(1).choice([-1.0, 1.0], (2 * ROWS, 6))
    log = monitored(
        model,
        sts,
        T * np.arange(3 * ROWS),
        np.vstack([q, np.tile(q[-1], (2 * ROWS, 1))]),
        np.vstack([v, chatter]),
        np.vstack([tau_ext, np.full((2 * ROWS, 6), 2.0)]),
        np.ones(3 * ROWS, bool),
        (3 * ROWS,),
    )
    (disagreement,) = log.disagreements()
    assert disagreement.joint == 2
    # 5 %: what rests hold tells a little of the offset, and so of the two others.
    assert log.drifts()[2] == pytest.approx(alone[2], rel=0.05)
    assert log.drift() == pytest.approx(log.drifts()[2], rel=1e-9)


@pytest.mark.parametrize("cuts", [(ROWS,), (1, 700, 703, ROWS)])
def test_more_viscous_friction_is_named_with_the_command_to_run(sts, model, cuts):
    t, q, v, noise = signals(sts)
    tau_ext = drifted(v, noise, 2, 6.0)
    free = np.ones(ROWS, bool)
    monitor = monitored(model, sts, t + 100.0, q, v, tau_ext, free, cuts)
    (disagreement,) = monitor.disagreements()
    assert (disagreement.joint, disagreement.term.name) == (2, "viscous")
    assert disagreement.change == pytest.approx(6.0, rel=0.15)
    lines = monitor.sentences("log.csv", "r", "model.yaml")
    assert "friction of joint_3 is not the model's" in lines[0]
    command = "wrenchsight identify log.csv --robot r --refresh model.yaml --out refreshed"
    assert lines[1] == f"refresh the model's friction: `{command}`"
    assert monitor.sentences("log.csv", "r", None) == []
    # On the log that the model was fitted on nothing has drifted, and nothing is to be refreshed.
    [sentence] = monitor.sentences("log.csv", "r", "model.yaml", is_fitted_on_log=True)
    assert "was fitted on this log, yet its friction law does not hold for" in sentence
    assert "--friction best" in sentence
    assert "refresh" not in sentence


def test_the_drift_for_the_band_is_what_the_stretches_show(sts, model):
    t, q, v, noise = signals(sts)
    error = torque_error(correlation_time=1.0, fitted_speed=1.0, fitted_load=1.0, K_0=K_0)
    with_error = replace(model, torque_error=error)
    free = np.ones(ROWS, bool)
    monitor = monitored(with_error, sts, t, q, v, drifted(v, noise, 2, 6.0), free)
    assert monitor.drift() == pytest.approx(0.6, rel=0.15)  # 6 of 10 N m s/rad
    np.testing.assert_allclose(monitor.drifts()[2], monitor.drift(), rtol=1e-9)
    assert np.delete(monitor.drifts(), 2).max() < 0.2  # what noise looks like, 1.4 se of it
    assert (
        "includes the friction drift"
        in monitor.sentences("log.csv", "r", "m.yaml", monitor.drifts())[-1]
    )
    # A joint that hardly moves may be off by any share of its viscous torque: it is not named.
    huge = np.array([0.1, 9.0, 0.6, 0.1, 0.1, 0.1])
    still = np.array([1.0, 1e-4, 1.0, 1.0, 1.0, 1.0])
    quiet = monitored(with_error, sts, t, q, v * still, drifted(v * still, noise, 2, 6.0), free)
    *_, line = quiet.sentences("log.csv", "r", "m.yaml", huge)
    assert "joint_2" not in line
    assert "joint_3 60 %" in line
    *_, last = monitor.sentences("log.csv", "r", "model.yaml")
    assert last.startswith("until then the stated band is too narrow")
    assert "pass --drift 0." in last
    assert monitored(with_error, sts, t, q, v, noise, free).drift() is None
    assert monitored(with_error, sts, t, q, v, noise, free).drifts() is None


def test_no_band_allows_for_more_drift_than_estimate_takes(sts, model):
    """15 times the model's viscous friction is another arm's."""
    t, q, v, noise = signals(sts)
    monitor = monitored(model, sts, t, q, v, drifted(v, noise, 2, 150.0), np.ones(ROWS, bool))
    assert monitor.drift() > LARGEST_DRIFT
    assert monitor.drifts()[2] == LARGEST_DRIFT == monitor.drifts().max()


def test_a_contact_is_left_out_and_the_part_without_it_is_offered(sts, model):
    t, q, v, noise = signals(sts)
    tau_ext = drifted(v, noise, 2, 6.0)
    tau_ext[:1000] += 60.0
    free = np.ones(ROWS, bool)
    free[:1000] = False
    for cuts in ((ROWS,), (900, 1020, 2500, ROWS)):
        monitor = monitored(model, sts, t + 100.0, q, v, tau_ext, free, cuts)
        (disagreement,) = monitor.disagreements()
        assert disagreement.change == pytest.approx(6.0, rel=0.15)
        # Half a second away from the contact, to the end of the log.
        command = monitor.sentences("log.csv", "r", "model.yaml")[-1]
        assert "--part 10.5,39.9 " in command or "--part 10.6,39.9 " in command


def test_a_stretch_goes_on_from_chunk_to_chunk_also_from_the_time_0_on(sts, model):
    t, q, v, noise = signals(sts)
    tau_ext = drifted(v, noise, 2, 6.0)
    free = t < 30.0
    for cuts in ((ROWS,), (1500, ROWS), (700, 1400, 2900, ROWS)):
        monitor = monitored(model, sts, t, q, v, tau_ext, free, cuts)
        command = monitor.sentences("log.csv", "r", "model.yaml")[-1]
        assert "--part 0,29.4 " in command


def test_no_stretch_goes_on_over_a_contact_before_a_chunk(sts, model):
    """The contact ends so long before the chunk that its margin ends there, too."""
    t, q, v, noise = signals(sts)
    tau_ext = drifted(v, noise, 2, 6.0)
    free = np.ones(ROWS, bool)
    free[1449] = False  # half a second before 1500
    monitor = monitored(model, sts, t + 100.0, q, v, tau_ext, free, (1500, ROWS))
    command = monitor.sentences("log.csv", "r", "model.yaml")[-1]
    assert "--part 15,39.9 " in command


def test_drift_is_found_where_the_flags_of_contact_are_wrong(sts, model):
    """A third of the log is flagged, and it is not the third in which a force acts."""
    t, q, v, noise = signals(sts)
    J = np.asarray(model.chain(sts).jacobian(q))
    is_touched = (t % 3.0) >= 2.0
    force = np.where(is_touched[:, None], [15.0, -20.0, 10.0], 0.0)
    tau_ext = drifted(v, noise, 2, 6.0) + np.einsum("kan,ka->kn", J[:, 3:], force)
    free = (t % 3.0) >= 1.0
    monitor = monitored(model, sts, t, q, v, tau_ext, free)
    (disagreement,) = monitor.disagreements()
    assert (disagreement.joint, disagreement.term.name) == (2, "viscous")
    assert abs(disagreement.change - 6.0) < 3.5 * disagreement.change_sd
    assert monitor.refreshed() is not None


def test_the_band_of_a_free_log_lies_about_todays_friction_where_drift_reads_as_contact(sts, model):
    """Nothing touches. Drift that flags most of the log is known in its sign."""
    t, q, v, noise = signals(sts)
    tau_ext = drifted(v, noise, 2, 6.0)
    mostly_flagged = monitored(model, sts, t, q, v, tau_ext, (t % 3.0) >= 2.0)
    refresh = mostly_flagged.refreshed()
    assert refresh is not None
    assert abs(refresh.change[2, 1] - 6.0) < 3.5 * refresh.standard_deviation[2, 1]
    hardly_flagged = monitored(model, sts, t, q, v, tau_ext, t >= 0.5)
    assert hardly_flagged.refreshed() is None
    assert mostly_flagged.drifts()[2] < 0.3 * hardly_flagged.drifts()[2]


def led(model, sts, work_share):
    """All joints are led for most of a log, by a hand that leaves drives a share of friction."""
    t, q, v, noise = signals(sts)
    friction = 5.0 * np.sign(v) + 10.0 * v
    is_led = (t > 8.0) & (t < 34.0)
    hand = (1.0 - work_share) * friction * is_led[:, None]
    tau_ext = noise + lfilter([1.0 - KEEP], [1.0, -KEEP], hand, axis=0)
    return monitored(model, sts, t, q, v, tau_ext, ~is_led)


def test_a_hand_that_leads_the_arm_is_no_drift_of_friction(sts, model):
    """It pushes along the motion: as drift, less than half of friction would be left."""
    monitor = led(model, sts, work_share=0.2)
    (sentence,) = monitor.sentences("log.csv", "r", "model.yaml")
    assert "as a hand does that leads it" in sentence
    assert monitor.refreshed() is None
    assert monitor.drifts() is None


def test_friction_that_has_fallen_by_a_third_is_drift(sts, model):
    monitor = led(model, sts, work_share=0.67)
    assert not any("a hand" in text for text in monitor.sentences("log.csv", "r", "model.yaml"))
    assert monitor.refreshed() is not None


def test_a_model_without_logs_is_not_judged(sts, model):
    t, q, v, noise = signals(sts)
    assumed = replace(model, provenance=Provenance())
    monitor = monitored(assumed, sts, t, q, v, drifted(v, noise, 1, 9.0), np.ones(ROWS, bool))
    assert monitor.sentences("log.csv", "r", "model.yaml") == []


def test_an_empty_log_gives_no_disagreement(sts, model):
    monitor = FrictionMonitor(model, model.chain(sts), None, T)
    assert monitor.disagreements() == []


def test_a_log_that_is_all_contact_shows_no_ripple(sts, model):
    """No row is left to look at: a force of 100 N, in another direction each second."""
    t, q, v, noise = signals(sts)
    directions = np.random.default_rng(1).normal(size=(ROWS // 100, 3)).repeat(100, axis=0)
    force = 100.0 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    J = model.chain(sts).jacobian(q)
    tau_ext = noise + np.einsum("kaj,ka->kj", J[:, 3:], force)
    with_error = replace(model, torque_error=torque_error())
    monitor = FrictionMonitor(with_error, with_error.chain(sts), np.full(6, K_0), T, sts)
    monitor.add(t, q, v, tau_ext, np.ones(ROWS, bool), np.zeros(ROWS, bool))
    assert monitor.ripple() is None
