"""Torque constants from weighed loads: known ones come back, and what is not told is said."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import harmonic_motion

from wrenchsight.models.calibration.gain_calibration import (
    GAIN_SD,
    CalibrationLog,
    GainProblem,
    KnownLoad,
)
from wrenchsight.models.calibration.load_parameters import body_parameters, load_columns
from wrenchsight.models.calibration.residual_noise import ResidualRows
from wrenchsight.models.friction.friction_structure import FrictionStructure

pytestmark = pytest.mark.long  # many logs are calibrated from

SD = np.array([1.0, 1.0, 0.6, 0.2, 0.2, 0.15])
TERMS = ("coulomb", "viscous", "offset", "load")
FRICTION = np.array(
    [
        [16.0, 22.0, 0.1, 0.02],
        [14.0, 18.0, -0.1, 0.06],
        [6.0, 10.0, 0.0, 0.07],
        [2.8, 3.6, 0.0, 0.03],
        [3.3, 2.4, 0.0, 0.03],
        [2.7, 3.2, 0.0, 0.02],
    ]
)
RATIO = np.array([0.95, 1.04, 1.02, 0.93, 0.97, 1.08])
LOAD = KnownLoad(3.0)
BODY = body_parameters(3.0, np.array([0.03, 0.09, 0.12]), 0.02 * np.eye(3))


@pytest.fixture(scope="module")
def structure():
    return replace(FrictionStructure.of("load-dependent", 6), terms=(TERMS,) * 6)


@pytest.fixture(scope="module")
def start(ur10e):
    """The robot's own inertias and friction that is off: where an identification would begin."""
    chain = ur10e.chain
    blocks = [
        np.r_[chain.reflected_inertia[j], FRICTION[j] * [1.1, 0.9, 1.0, 1.0]] for j in range(6)
    ]
    return np.concatenate([chain.inertial_parameters.ravel(), *blocks])


def log(robot, structure, seed, load=None, body=None, noise=1.0, duration=25.0, drift=0.0):
    """A log of currents times the stated torque constants, its friction off by so many sds."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 0.1)
    q, v, vdot = harmonic_motion(rng, t, 0.8 * np.arange(1, 6), 0.6, least=0.5)
    q += robot.home
    carried = robot.chain.inverse_dynamics(q, v, vdot)
    if load is not None:
        carried = carried + load_columns(robot, q, v, vdot) @ body
    columns = structure.columns(q, v, carried)
    off = np.random.default_rng([seed, 1]).normal(size=(6, 4)) * [0.05, 0.1, 0.0, 0.0]
    today = FRICTION * (1.0 + drift * off)
    friction = np.stack([columns[j] @ today[j] for j in range(6)], axis=1)
    tau = (carried + friction) / RATIO
    dry = friction - FRICTION[:, 1] * v - FRICTION[:, 2]
    rows = ResidualRows(
        t, v, tau, dry, FRICTION[:, 1] * v, np.abs(dry), np.zeros((*v.shape, 3)), SD
    )
    for j in range(6):
        lower = np.linalg.cholesky(rows.covariance(j))
        tau[:, j] += noise * lower @ rng.normal(size=len(t))
    return CalibrationLog(t, q, v, vdot, tau, lambda x: x, np.arange(len(t)), load)


def problem(robot, structure, start, logs, loads):
    return GainProblem(robot, logs, loads, structure, start, SD)


@pytest.mark.parametrize("drift", [0.0, 1.0])
def test_ratios_load_dependence_and_centre_of_mass_within_their_errors(
    ur10e, structure, start, drift
):
    z = []
    for seed in range(6):
        logs = [
            log(ur10e, structure, 10 * seed, drift=drift),
            log(ur10e, structure, 10 * seed + 1, drift=drift),
            log(ur10e, structure, 10 * seed + 2, 0, BODY, drift=drift),
        ]
        calibration = problem(ur10e, structure, start, logs, [LOAD]).solve()
        value, sd = calibration.load_dependence
        z.append(
            np.r_[
                (calibration.ratio - RATIO) / calibration.ratio_sd,
                (value - FRICTION[:, 3]) / sd,
                (calibration.loads[0, 1:4] - BODY[1:4]) / calibration.load_sd[0, 1:4],
            ]
        )
    scores = np.abs(np.array(z))
    # 90 scores; those of one log share its residual, as if 30 of them were independent: 4 % sd.
    assert (scores < 1.96).mean() > 0.95 - 3.0 * 0.04
    assert scores.max() < 4.5
    assert (calibration.ratio_sd < 0.05).all()


def test_without_noise_they_are_exact(ur10e, structure, start):
    logs = [
        log(ur10e, structure, 1, noise=0.0),
        log(ur10e, structure, 2, 0, BODY, noise=0.0),
    ]
    calibration = problem(ur10e, structure, start, logs, [LOAD]).solve()
    # Within a tenth of what the stated errors allow: the priors pull that much.
    np.testing.assert_array_less(np.abs(calibration.ratio - RATIO), 0.3 * calibration.ratio_sd)
    np.testing.assert_allclose(calibration.ratio, RATIO, atol=3e-3)


def test_without_a_weight_the_common_scale_is_not_determined(ur10e, structure, start):
    """Of joints 2 and 3, which carry the same masses: each to the other, but not both alike."""

    def sd_of_common_and_relative(calibration):
        u = calibration.log_covariance[1:3, 1:3]
        return np.sqrt(u.mean()), np.sqrt(u[0, 0] + u[1, 1] - 2.0 * u[0, 1])

    logs = [log(ur10e, structure, 1), log(ur10e, structure, 2)]
    bare = problem(ur10e, structure, start, logs, []).solve()
    laden = [*logs, log(ur10e, structure, 3, 0, BODY)]
    weighed = problem(ur10e, structure, start, laden, [LOAD]).solve()
    common, relative = sd_of_common_and_relative(bare)
    # What the robot's own file says of its masses, as a prior, tells something of the scale.
    assert common > 0.1 * GAIN_SD
    assert relative < 0.2 * common
    assert sd_of_common_and_relative(weighed)[0] < 0.3 * common
    assert weighed.least_known[1] < bare.least_known[1]


def test_a_known_centre_of_mass_stays_where_it_is(ur10e, structure, start):
    com = BODY[1:4] / 3.0
    logs = [log(ur10e, structure, 1), log(ur10e, structure, 2, 0, BODY)]
    load = KnownLoad(3.0, (float(com[0]), float(com[1]), float(com[2])))
    free = problem(ur10e, structure, start, logs, [LOAD]).solve()
    with_known_com = problem(ur10e, structure, start, logs, [load]).solve()
    np.testing.assert_allclose(with_known_com.loads[0, 1:4] / 3.0, com, atol=3e-3)
    assert (with_known_com.ratio_sd[3:] < free.ratio_sd[3:]).all()
