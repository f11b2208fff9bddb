"""Friction of another specimen, against rows made of known coefficients."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.models.calibration.specimen_friction import (
    SlidingRows,
    SpecimenPrior,
    fit_specimen,
)
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction

_KNOWN = PreslidingFriction(
    SemiParametricFriction(CoulombViscous(np.zeros(2), np.array([20.0, 3.0]), np.zeros(2))),
    coulomb=np.array([10.0, 3.0]),
    stribeck=np.array([2.0, 0.0]),
    stribeck_velocity=np.array([0.1, 0.1]),
    load=np.array([0.06, 0.0]),
    cubic=np.array([-3.0, 0.0]),
    weight=np.ones((2, 1)),
    displacement=np.full((2, 1), 1e-4),
)
_NONE = SlidingRows(*np.zeros((5, 0)))


def _rows(rng: np.random.Generator, gain: float = 0.0, noise: float = 0.5) -> SlidingRows:
    """400 rows of a joint with coulomb 7, load .07, viscous 30, offset .4; the rest as known."""
    v = rng.uniform(0.03, 0.5, 400) * rng.choice([-1.0, 1.0], 400)
    load = rng.uniform(40.0, 120.0, 400)
    side = np.sign(v)
    friction = (7.0 + 0.07 * load + 2.0 * np.exp(-((v / 0.1) ** 2))) * side + 30.0 * v + 0.4
    friction += -3.0 * v**3 + rng.normal(0.0, noise, 400)
    external = rng.uniform(-60.0, 0.0, 400)
    return SlidingRows(side, v, load, friction + gain * external, external)


def test_the_other_specimens_friction_is_found():
    rows = _rows(np.random.default_rng(3))
    fit = fit_specimen(_KNOWN, [rows, _NONE], SpecimenPrior(dependence=1.0))
    values = [fit.law.coulomb[0], fit.law.load[0]]
    plain = fit.law.coulomb_viscous
    values += [plain.viscous[0], plain.offset[0]]
    sd = np.array([fit.sd.coulomb[0], fit.sd.load[0], fit.sd.viscous[0], fit.sd.offset[0]])
    # Four of the stated deviations: one false alarm in 4000.
    np.testing.assert_array_less(np.abs(np.array(values) - [7.0, 0.07, 30.0, 0.4]), 4.0 * sd)
    assert np.all(sd < [0.6, 0.006, 1.0, 0.15])
    assert fit.scatter[0] == pytest.approx(0.5, rel=0.15)
    assert abs(fit.gain) < 4.0 * fit.gain_sd
    assert fit.gain_sd < 0.01


def test_a_joint_without_rows_keeps_what_is_known():
    fit = fit_specimen(_KNOWN, [_rows(np.random.default_rng(4)), _NONE])
    assert fit.law.coulomb[1] == 3.0
    assert fit.law.coulomb_viscous.viscous[1] == 3.0
    assert np.isnan(fit.scatter[1])
    assert fit.rows.tolist() == [400, 0]


def test_shocks_weigh_little():
    rng = np.random.default_rng(5)
    rows = _rows(rng)
    shocked = rows.torque + np.where(rng.random(400) < 0.1, 40.0, 0.0)
    plain = fit_specimen(_KNOWN, [rows, _NONE])
    other = SlidingRows(rows.side, rows.v, rows.load, shocked, rows.external)
    fit = fit_specimen(_KNOWN, [other, _NONE])
    # A tenth of the rows off by 40 N m moves a mean by 4.
    assert fit.law.coulomb_viscous.offset[0] == pytest.approx(
        plain.law.coulomb_viscous.offset[0], abs=0.1
    )
    assert fit.law.coulomb[0] == pytest.approx(plain.law.coulomb[0], abs=0.3)


def test_torque_constants_are_found_where_a_known_force_tells_them():
    rows = _rows(np.random.default_rng(6), gain=0.04)
    prior = SpecimenPrior(dependence=1.0)
    fit = fit_specimen(_KNOWN, [rows, _NONE], prior)
    assert fit.gain == pytest.approx(0.04, abs=4.0 * fit.gain_sd)
    assert fit.gain_sd < 0.005  # a hundredth of 35 N m is the mean of 400 rows of .5 N m
    free = replace(rows, torque=rows.torque - 0.04 * rows.external, external=0.0 * rows.external)
    untold = fit_specimen(_KNOWN, [free, _NONE], prior)
    assert (untold.gain, untold.gain_sd) == (0.0, prior.gain)


def test_the_gain_is_one_for_the_arm():
    rows = [_rows(np.random.default_rng(k), gain=gain) for k, gain in ((7, 0.03), (8, 0.05))]
    fit = fit_specimen(_KNOWN, rows, SpecimenPrior(dependence=1.0))
    assert fit.gain == pytest.approx(0.04, abs=0.01)
    # What it does not explain of a joint's own, at the mean of -30 N m, is offset.
    offset = fit.law.coulomb_viscous.offset
    assert offset[0] == pytest.approx(0.4 + 30.0 * (fit.gain - 0.03), abs=0.15)
