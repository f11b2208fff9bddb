"""The torque error's sd: its formula, rest and sliding, rounding, averages, other gains."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sample_models import sample_torque_error, torque_sds

from wrenchsight.models.estimation.torque_error_stage import TorqueErrorStage
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.torque_error_model import (
    REST_ROW,
    TORQUE_ERROR_ROWS,
    LawHoldsAtRest,
    TorqueErrorModel,
    averaged_share,
    hidden_torque,
    rest_rows,
    torque_at_unseen_rest,
    torque_sd_rows,
)

N = 2
STEP = 0.01
VISCOUS = np.array([20.0, 3.0])


def law(**changes: Any) -> PreslidingFriction:
    values: dict[str, Any] = {
        "velocity_law": SemiParametricFriction(CoulombViscous(np.zeros(N), VISCOUS, np.zeros(N))),
        "coulomb": np.array([20.0, 2.5]),
        "stribeck": np.array([-4.0, 0.5]),
        "stribeck_velocity": np.array([0.1, 0.05]),
        "load": np.array([0.05, 0.0]),
        "cubic": np.array([-1.0, 0.2]),
        "weight": np.ones((N, 1)),
        "displacement": np.full((N, 1), 1e-4),
        "speed_limit": np.array([1.5, 1.2]),
    }
    return PreslidingFriction(**(values | changes))


def model(**changes: Any) -> TorqueErrorModel:
    values: dict[str, Any] = {
        "constant": np.array([0.8, 0.12]),
        "speed": np.array([0.5, 0.1]),
        "load": np.array([0.02, 0.05]),
        "acceleration": np.array([0.3, 0.02]),
        "reversal": np.array([0.6, 0.4]),
        "correlation": np.array([[1.0, 0.2], [0.2, 1.0]]),
        "correlation_time": np.array([0.4, 0.2]),
        "lasting": np.array([0.05, 0.0]),
        "fitted_speed": np.array([1.5, 1.2]),
        "fitted_load": np.array([40.0, 5.0]),
        "K_0": np.full(N, 20.0),
        "resolution": np.full(N, 1e-4),
    }
    return TorqueErrorModel(**(values | changes))


def motion(samples: int = 600) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Slow and fast, with reversals and a rest, positions rounded to .1 mrad."""
    t = STEP * np.arange(600)
    q = np.stack([0.9 * np.sin(2.0 * t), 0.8 * np.cos(2.6 * t)], axis=1)
    q[400:500] = q[400]
    v = np.gradient(q, STEP, axis=0)
    v[400:500] = 0.0
    load = np.stack([60.0 * np.cos(t), 4.0 * np.sin(t)], axis=1)
    return np.round(q, 4)[:samples], v[:samples], load[:samples]


@pytest.mark.parametrize("reversal", [np.array([0.6, 0.4]), np.array([100.0, 100.0])])
def test_the_formula_written_out(reversal: np.ndarray) -> None:
    """A fitted `reversal` of 100 counts as far as friction may err: from one direction to the
    other.
    """
    error_model, friction, (q, v, load) = model(reversal=reversal), law(), motion()
    computed, stiction = torque_sds(error_model, friction, q, v, load, STEP)
    pole = np.exp(-20.0 * STEP)
    p, w, r, z = q[0].copy(), np.ones(N), np.ones(N), np.ones(N)
    followed = q[0].copy()
    unknown = turning = slow = last_load = np.zeros(N)
    is_bounded = np.zeros(N, bool)
    for k in range(len(q)):
        at = np.clip(p + v[k] * STEP, q[k] - 5e-5, q[k] + 5e-5) if k else q[0]
        moved, p = (at - p) / error_model.reach, at
        fading = np.exp(-((v[k] / friction.stribeck_velocity) ** 2))
        level = friction.coulomb + friction.stribeck * fading + friction.load * np.abs(last_load)
        slid, followed = followed, np.clip(followed, p - 1e-4, p + 1e-4)
        slid = np.abs(followed - slid) / error_model.reach
        w = (1.0 - (1.0 - w) * np.exp(-2.0 * STEP / error_model.rest_time)) * np.exp(-slid)
        still = np.exp(-((slid * error_model.reach / (1e-4 * STEP)) ** 2)) if k else np.zeros(N)
        r = r * np.exp(-slid)
        r = r + still * (1.0 - np.exp(-STEP / 1.0)) * (1.0 - r)
        share = np.maximum(w, r)
        z = np.clip(z + moved, -1.0, 1.0)
        a = pole if k else 0.0
        unknown = a * unknown + (1.0 - a) * level * np.sqrt(share / 3.0)
        turning = a * turning + (1.0 - a) * level * (1.0 - z**2) * (1.0 - share)
        slow = a * slow + (1.0 - a) * v[k]
        largest = friction.coulomb + np.maximum(friction.stribeck, 0.0)
        largest = largest + friction.load * np.abs(last_load)
        turned = np.minimum(error_model.reversal * turning, 2.0 * largest)
        is_bounded |= turned == 2.0 * largest
        held = unknown**2 + turned**2
        viscous = VISCOUS * v[k] + friction.cubic * v[k] ** 3
        fast = np.abs(v[k]) - friction.speed_limit
        tangent = np.maximum(3.0 * friction.cubic * friction.speed_limit**2, -VISCOUS)
        viscous = np.where(
            fast > 0.0,
            VISCOUS * v[k]
            + np.sign(v[k]) * (friction.cubic * friction.speed_limit**3 + tangent * fast),
            viscous,
        )
        variance = (
            error_model.constant**2
            + (error_model.speed * v[k]) ** 2
            + (error_model.load * last_load) ** 2
        )
        variance += (error_model.acceleration * 20.0 * (v[k] - slow)) ** 2 + held
        variance += (error_model.drift * viscous) ** 2
        variance += (
            error_model.beyond_speed
            * VISCOUS
            * np.maximum(np.abs(v[k]) - error_model.fitted_speed, 0.0)
        ) ** 2
        variance += (
            error_model.beyond_load * np.maximum(np.abs(last_load) - error_model.fitted_load, 0.0)
        ) ** 2
        np.testing.assert_allclose(computed[k], np.sqrt(variance), rtol=1e-10)
        np.testing.assert_allclose(stiction[k], np.sqrt(held), rtol=1e-10, atol=1e-14)
        last_load = load[k]
    assert (is_bounded == (reversal > 1.0)).all()
    assert (np.abs(v) > error_model.fitted_speed).any()
    assert (np.abs(load) > error_model.fitted_load).any()


def test_tick_by_tick_is_the_log() -> None:
    error_model, friction, (q, v, load) = model(), law(), motion(200)
    sd, stiction = torque_sds(error_model, friction, q, v, load, STEP)
    table, state = error_model.table(friction, STEP, 20.0), error_model.initial_state()
    assert state.shape == (TORQUE_ERROR_ROWS, N)
    for k in range(200):
        tick = slice(k, k + 1)
        tick_sd, held, drift = np.zeros((1, N)), np.empty((1, N)), np.empty((1, N))
        rows = np.empty((1, TORQUE_ERROR_ROWS, N))
        rest_rows(table, state, q[tick], v[tick], rows)
        torque_sd_rows(
            table, state, v[tick], load[tick], np.zeros((1, N)), rows, tick_sd, held, drift
        )
        np.testing.assert_array_equal(tick_sd[0], sd[k])
        np.testing.assert_array_equal(held[0], stiction[k])


def still(samples: int = 500) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    q = np.full((samples, N), 0.3)
    return q, np.zeros_like(q), np.zeros_like(q)


def test_a_joint_at_rest_has_the_sd_of_its_stiction_band() -> None:
    """Even between minus and plus 16 and 3 N m, of variance 16^2 / 3 and 3^2 / 3."""
    sd, stiction = torque_sds(model(), law(), *still(), STEP)
    level = np.array([16.0, 3.0])
    np.testing.assert_allclose(stiction, np.tile(level / np.sqrt(3.0), (500, 1)), rtol=1e-12)
    np.testing.assert_allclose(sd, np.hypot(stiction, model().constant), rtol=1e-12)


def test_a_law_without_friction_at_a_crawl_still_holds_half_of_it_at_rest() -> None:
    """S of a log that shows no crawl may be anything; C - 22 N m would hold nothing."""
    friction = law(stribeck=np.array([-22.0, 0.5]))
    _, stiction = torque_sds(model(), friction, *still(), STEP)
    np.testing.assert_allclose(stiction[-1], np.array([10.0, 3.0]) / np.sqrt(3.0), rtol=1e-12)


def test_the_load_widens_the_band_of_a_joint_at_rest() -> None:
    q, v, load = still()
    load[:] = 30.0
    _, stiction = torque_sds(model(), law(), q, v, load, STEP)
    np.testing.assert_allclose(stiction[-1, 0], (16.0 + 0.05 * 30.0) / np.sqrt(3.0), rtol=1e-4)


def test_sliding_forgets_stiction_and_rest_brings_it_back() -> None:
    """At .2 rad/s next to nothing is unknown; five rest times later, all."""
    slide = 0.2 * STEP * np.arange(200)
    q = np.concatenate([slide, np.full(250, slide[-1])])[:, None] * np.ones(N)
    v = np.concatenate([np.full(200, 0.2), np.zeros(250)])[:, None] * np.ones(N)
    _, stiction = torque_sds(model(), law(), q, v, np.zeros_like(q), STEP)
    assert (stiction[199] < 0.12 * model().constant).all()
    np.testing.assert_allclose(stiction[-1], np.array([16.0, 3.0]) / np.sqrt(3.0), rtol=1e-3)


def test_a_joint_that_creeps_rests_at_any_speed_or_only_at_rest() -> None:
    """At 6 mrad/s w stays at 2 reach / (rest_time v) = .2 in the one; none is left in the other."""
    t = STEP * np.arange(600)
    q = np.stack([6e-3 * t, np.zeros_like(t)], axis=1)
    v = np.broadcast_to([6e-3, 0.0], q.shape)
    at_any_speed, resting_only = (
        torque_sds(model(resting_only=only), law(), q, v, np.zeros_like(q), STEP)[1][-1]
        for only in (0.0, 1.0)
    )
    level = law().coulomb + law().stribeck
    assert 0.15 < 3.0 * (at_any_speed[0] / level[0]) ** 2 < 0.2
    assert resting_only[0] < 1e-3 * level[0]
    assert at_any_speed[1] == resting_only[1] == pytest.approx(level[1] / np.sqrt(3.0), rel=0.01)


def test_a_reversal_is_remembered_as_long_as_the_observer_remembers_it() -> None:
    t = STEP * np.arange(400)
    v = 3.0 * (1.0 - t)[:, None] * np.ones(N)  # turns at 1 s
    q = 3.0 * (t - 0.5 * t**2)[:, None] * np.ones(N)
    error_model = model(resolution=np.zeros(N))
    _, stiction = torque_sds(error_model, law(), q, v, np.zeros_like(q), STEP)
    peak = 50 + stiction[50:, 0].argmax()  # before: the start, where nothing is known
    assert 100 <= peak <= 108
    assert stiction[90, 0] < 0.1 * stiction[peak, 0]
    fading = stiction[peak + 15 : peak + 25, 0]
    np.testing.assert_allclose(fading[1:] / fading[:-1], np.exp(-20.0 * STEP), atol=0.03)


def test_an_encoder_that_flickers_does_not_move_a_joint_at_rest() -> None:
    q, v, load = still()
    q = q + np.where(np.arange(500) % 3 == 0, 1e-4, 0.0)[:, None]
    sd, _ = torque_sds(model(), law(), q, v, load, STEP)
    quiet, _ = torque_sds(model(), law(), *still(), STEP)
    np.testing.assert_allclose(sd[100:], quiet[100:], rtol=2e-2)
    q = 0.3 + 6.0 * (q - 0.3)  # beyond the play: it moves
    sharp, _ = torque_sds(model(), law(), q, v, load, STEP, resolution=0.0)
    assert (sharp[100:, 0] < 0.8 * quiet[100:, 0]).all()


def resting_rows(
    noise: float, friction: Any, error_model: TorqueErrorModel | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """REST_ROW and hidden torque along a slide of 1 s at .1 rad/s and a rest of 2 s."""
    error_model = error_model or model()
    t = STEP * np.arange(300)
    rng = np.random.default_rng(3)
    q = np.round(0.1 * np.minimum(t, 1.0)[:, None] * np.ones(N), 4)
    v = np.where(t < 1.0, 0.1, 0.0)[:, None] + rng.normal(0.0, noise, q.shape)
    table, state = error_model.table(friction, STEP, 20.0), error_model.initial_state()
    rows, sds = np.empty((300, TORQUE_ERROR_ROWS, N)), np.zeros((3, 300, N))
    rest_rows(table, state, q, v, rows)
    nothing = np.full((300, N), np.nan)
    torque_sd_rows(table, state, v, nothing, nothing, rows, *sds)
    hidden = np.array([[hidden_torque(table, row, j) for j in range(N)] for row in rows])
    return rows[:, REST_ROW], hidden


def coulomb() -> SemiParametricFriction:
    return SemiParametricFriction(CoulombViscous(np.array([14.0, 3.0]), VISCOUS, np.zeros(N)))


@pytest.mark.parametrize("noise", [0.0, 2e-3])
def test_noise_of_the_velocity_does_not_hide_a_rest(noise: float) -> None:
    """2 mrad/s at 100 Hz adds up to .16 mrad in half a second: less than what play leaves out."""
    rest, hidden = resting_rows(noise, coulomb(), model(held=1.1, rests=1.0))
    assert (rest[50:100] < 1e-6).all()  # it slides 50 mrad, reach is .3 mrad
    assert (hidden[60:100] < 0.03).all()  # the share w of a slide: 2e-3 of the level
    # From a tenth of a second after the stop on, all that friction can hold, 1.1 times the level.
    level = 1.1 * np.array([14.0, 3.0])
    assert (hidden[112:] >= 0.99 * level).all()
    assert (hidden < 2.0 * level).all()
    assert (rest[160:] > 0.97).all()  # six times RECOGNITION, less what creeps


def test_a_law_with_memory_keeps_what_the_joint_held_for_a_second() -> None:
    rest, _ = resting_rows(0.0, law())
    np.testing.assert_allclose(rest[200], 1.0 - np.exp(-1.0), atol=0.02)
    rigid, _ = resting_rows(0.0, law(displacement=np.zeros((N, 1))))
    assert (rigid[160:] > 0.99).all()


def test_what_joints_hold_that_rested_in_no_log_is_not_known() -> None:
    seen = model().with_rests(np.array([2.0, 0.0]), np.array([1.3, 0.0]))
    np.testing.assert_array_equal(seen.held, [1.3, 2.0])
    np.testing.assert_array_equal(model().with_rests(np.ones(N), np.full(N, 0.4)).held, [1.1, 1.1])
    rest, hidden = resting_rows(0.0, coulomb(), seen)
    assert hidden[-1, 0] == pytest.approx(1.3 * 14.0, rel=1e-3)
    # From .07 s after the stop on: r passes a half after RECOGNITION ln 2.
    np.testing.assert_array_equal(np.isinf(hidden[:, 1]), rest[:, 1] > 0.5)
    assert np.isinf(hidden[110:, 1]).all() and np.isfinite(hidden[50:104]).all()


def test_a_torque_beyond_friction_at_an_unseen_rest_is_found() -> None:
    """Beyond 1.1 times 14 and 3 N m, of the joint alone that rested in no log."""
    error = model().with_rests(np.array([2.0, 0.0]), np.ones(N))
    table = error.table(coulomb(), STEP, 20.0)
    rows = np.tile(error.initial_state(), (5, 1, 1))
    rows[4, REST_ROW] = 0.4  # not known to rest
    tau_ext = np.array([[60.0, 3.2], [0.0, -3.4], [0.0, 3.4], [np.nan, np.nan], [0.0, 3.4]])
    found = torque_at_unseen_rest(table, rows, tau_ext)
    np.testing.assert_array_equal(found, [False, True, True, False, False])
    seen = model(rests=np.ones(N)).table(coulomb(), STEP, 20.0)
    assert not torque_at_unseen_rest(seen, rows, tau_ext).any()


def test_a_change_in_the_last_digit_of_a_position_stays_one() -> None:
    error_model, friction, (q, v, load) = model(), law(), motion()
    sd, _ = torque_sds(error_model, friction, q, v, load, STEP)
    shift = 1e-12 * np.random.default_rng(0).choice([-1.0, 1.0], q.shape)
    shifted, _ = torque_sds(error_model, friction, q + shift, v + shift, load, STEP)
    # Some 20 N m over .3 mrad, and 1e-12 rad a tick for as long as w lasts.
    np.testing.assert_allclose(shifted, sd, atol=1e-6)


def test_a_sample_that_is_not_finite_costs_its_row_alone() -> None:
    error_model, friction, (q, v, load) = model(), law(), motion(300)
    broken, fast = q.copy(), v.copy()
    broken[100], fast[150] = np.nan, np.inf
    sd, stiction = torque_sds(error_model, friction, broken, fast, load, STEP)
    assert np.isfinite(sd).all()
    assert np.isfinite(stiction).all()
    whole, _ = torque_sds(error_model, friction, q, v, load, STEP)
    np.testing.assert_array_equal(sd[:100], whole[:100])
    np.testing.assert_allclose(sd[200:], whole[200:], rtol=0.02)


def test_another_gain_filters_the_smooth_part_as_the_observer_does() -> None:
    """A process of correlation time T through K_0 / (s + K_0), simulated."""
    T, step, K_0 = 0.2, 1e-3, np.array([5.0, 40.0])
    rng = np.random.default_rng(1)
    a = np.exp(-step / T)
    x = np.zeros(400_000)
    noise = rng.normal(scale=np.sqrt(1.0 - a * a), size=len(x))
    for k in range(1, len(x)):
        x[k] = a * x[k - 1] + noise[k]
    rms = []
    for gain in (20.0, *K_0):
        pole, y, total = np.exp(-gain * step), 0.0, 0.0
        for value in x:
            y = pole * y + (1.0 - pole) * value
            total += y * y
        rms.append(np.sqrt(total / len(x)))
    error_model = model(
        correlation_time=np.full(N, T),
        speed=np.zeros(N),
        acceleration=np.zeros(N),
        load=np.zeros(N),
    )
    calm = law(coulomb=np.zeros(N), stribeck=np.zeros(N), load=np.zeros(N))
    for gain, measured in zip(K_0, rms[1:], strict=True):
        sd, _ = torque_sds(error_model, calm, *still(), STEP, K_0=gain)
        # 400 s hold some thousand correlation times: 3 % of an sd.
        np.testing.assert_allclose(sd[-1] / error_model.constant, measured / rms[0], rtol=0.05)


def test_an_average_over_a_window() -> None:
    T, step = 0.3, 0.01
    rng = np.random.default_rng(2)
    a = np.exp(-step / T)
    x = rng.normal(size=2000)  # runs side by side
    windows = {10: [], 100: [], 300: []}  # type: dict[int, list[float]]
    total, count = np.zeros(2000), 0
    for _ in range(300):
        x = a * x + np.sqrt(1.0 - a * a) * rng.normal(size=2000)
        total, count = total + x, count + 1
        if count in windows:
            windows[count] = [float(np.std(total / count))]
    for samples, (spread,) in windows.items():
        computed = np.sqrt(averaged_share(samples * step / T))
        np.testing.assert_allclose(computed, spread, rtol=0.06)  # 2000 runs: 1.6 % of an sd
    assert averaged_share(0.0) == pytest.approx(1.0, abs=1e-5)


def test_the_drift_is_the_part_of_the_variance_that_it_adds() -> None:
    """Who takes its square off, as smoothing does, has what is left without it; cubic included."""
    friction, (q, v, load) = law(), motion()
    J = np.zeros((len(q), 6, N))
    (sd, _, drift, *_), (plain, *_) = (
        stage.run(stage.initial_state(), q, v, load, J)
        for stage in (
            TorqueErrorStage(model(drift=share), friction, 20.0, STEP, None) for share in (0.3, 0.0)
        )
    )
    np.testing.assert_allclose(np.sqrt(sd**2 - drift**2), plain, rtol=1e-9)
    assert (drift * v >= 0.0).all()
    at = np.abs(v[:, 0]).argmax()
    assert abs(drift[at, 0]) < 0.95 * 0.3 * VISCOUS[0] * abs(v[at, 0])  # the law bends down


def test_a_law_without_memory_has_its_coulomb_friction_as_band() -> None:
    plain = SemiParametricFriction(CoulombViscous(np.array([9.0, 3.0]), VISCOUS, np.zeros(N)))
    _, stiction = torque_sds(model(), plain, *still(), STEP)
    np.testing.assert_allclose(stiction[-1], np.array([9.0, 3.0]) / np.sqrt(3.0), rtol=1e-12)


def test_the_stated_assumptions_are_numbers_of_the_model() -> None:
    error_model, friction, (q, v, load) = model(), law(), motion()
    plain = replace(error_model, drift=0.0, beyond_speed=0.0, beyond_load=0.0)
    assert (
        torque_sds(error_model, friction, q, v, load, STEP)[0]
        >= torque_sds(plain, friction, q, v, load, STEP)[0]
    ).all()
    refreshed = error_model.with_drift(0.0)
    assert refreshed.drift == 0.0
    assert refreshed.beyond_speed == error_model.beyond_speed


def test_the_drift_that_a_log_shows_counts_where_it_is_more() -> None:
    error_model, friction, (q, v, load) = model(drift=0.1), law(), motion()
    shown = replace(error_model, drift_shown=np.array([0.4, 0.05]))
    np.testing.assert_array_equal(shown.drifts, [0.4, 0.1])
    computed = torque_sds(shown, friction, q, v, load, STEP)[0]
    expected = torque_sds(replace(error_model, drift=0.4), friction, q, v, load, STEP)[0]
    np.testing.assert_array_equal(computed[:, 0], expected[:, 0])
    np.testing.assert_array_equal(
        computed[:, 1], torque_sds(error_model, friction, q, v, load, STEP)[0][:, 1]
    )
    np.testing.assert_array_equal(shown.with_drift(0.2).drifts, [0.2, 0.2])


@pytest.mark.parametrize("shown", [0.0, [0.3, 0.0]])
def test_plain_numbers_and_back(shown: Any) -> None:
    error_model = model(drift=0.1, drift_shown=shown)
    values = error_model.to_dict()
    again = TorqueErrorModel(**values)
    assert again.to_dict() == values
    assert all(isinstance(value, (float, list)) for value in values.values())


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("constant", [0.0, 1.0]),
        ("speed", [-1.0, 1.0]),
        ("load", [1.0]),
        ("acceleration", [np.nan, 1.0]),
        ("correlation", [[1.0, 1.0], [1.0, 1.0]]),
        ("correlation", [[2.0, 0.0], [0.0, 1.0]]),
        ("correlation_time", [0.0, 1.0]),
        ("reach", 0.0),
        ("drift", -0.1),
        ("spread", np.zeros((1, 3, 5))),
        ("fitted_spread", -1.0),
    ],
)
def test_impossible_constants_are_refused(key: str, value: object) -> None:
    with pytest.raises(ValueError, match=key):
        model(**{key: value})


def test_the_article_s_law_holds_at_rest():
    error, law = sample_torque_error(), CoulombViscous(*np.full((3, 6), 0.5))
    friction = SemiParametricFriction(law)
    table = error.table(friction, 1e-3, np.full(6, 20.0))
    held = LawHoldsAtRest.of(error).table(friction, 1e-3, np.full(6, 20.0))
    [column] = np.flatnonzero((table != held).any(axis=0))
    assert (table[:, column] > 0.0).all()
    assert not held[:, column].any()
