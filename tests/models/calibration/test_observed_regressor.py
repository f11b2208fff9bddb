"""A load's torque as the observer shows it, against the estimator's reading of a load."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lfilter

from wrenchsight.models.calibration.load_parameters import body_parameters, load_columns
from wrenchsight.models.calibration.observed_regressor import ObservedRegressor
from wrenchsight.models.identification.identified_model import IdentifiedModel

T, ROWS, K_0 = 0.004, 5000, 15.0
KEEP = np.exp(-K_0 * T)


def motion(robot):
    t = T * np.arange(ROWS)
    rate = np.array([1.1, 1.3, 1.7, 1.9, 2.3, 2.9])
    phase = t[:, None] * rate + np.arange(6)
    q = robot.home + 0.3 * np.sin(phase)
    return q, 0.3 * rate * np.cos(phase), -0.3 * rate**2 * np.sin(phase)


def test_a_loads_torque_through_the_pole(ur10e):
    q, v, vdot = motion(ur10e)
    regressor = ObservedRegressor(ur10e, IdentifiedModel.nominal(ur10e), np.full(6, K_0), T)
    at = np.arange(1000, ROWS, 50)
    cuts = [0, 1, 700, 701, 4000, ROWS]
    parts = []
    for begin, end in pairwise(cuts):
        rows = at[(at >= begin) & (at < end)] - begin
        parts.append(regressor.along(q[begin:end], v[begin:end], rows)[0])
    load = body_parameters(2.0, np.array([0.05, -0.1, 0.08]), 0.01 * np.eye(3))
    exact = load_columns(ur10e, q, v, vdot) @ load
    exact = lfilter([1.0 - KEEP], [1.0, -KEEP], exact, axis=0)[at]
    torque = np.concatenate(parts) @ load
    # The difference of two velocities is half a sample late: 2 ms of 2.9 rad/s.
    np.testing.assert_allclose(torque, exact, atol=0.01 * np.abs(exact).max())
    whole = ObservedRegressor(ur10e, IdentifiedModel.nominal(ur10e), np.full(6, K_0), T)
    np.testing.assert_allclose(np.concatenate(parts), whole.along(q, v, at)[0], atol=1e-12)


def test_the_uncertain_parameters_columns_are_those_of_its_parameters(ur10e):
    q, v, vdot = motion(ur10e)
    nominal = IdentifiedModel.nominal(ur10e)
    links = ur10e.joint_names
    names = [f"m[{links[5]}]", f"coulomb[{links[0]}]"]
    table = replace(nominal.base_parameters, names=names, values=[1.0, 1.0])
    table = replace(table, standard_deviations=[0.1, 0.1])
    model = replace(nominal, base_parameters=table)
    regressor = ObservedRegressor(ur10e, model, None, T)
    at = np.arange(100, 200)
    _, columns = regressor.along(q, v, at)
    if not columns.shape[2]:
        pytest.fail("the parameter's name is not known")
    np.testing.assert_allclose(regressor.model_sd, [0.2])
    expected = ur10e.chain.regressor(q, v, vdot)[at, :, 50]
    np.testing.assert_allclose(columns[:, :, 0], expected, atol=0.01 * np.abs(expected).max())


def test_missing_samples_leave_it_finite(ur10e):
    q, v, _ = motion(ur10e)
    q[100:110], v[105] = np.nan, np.nan
    regressor = ObservedRegressor(ur10e, IdentifiedModel.nominal(ur10e), np.full(6, K_0), T)
    columns, _ = regressor.along(q, v, np.arange(ROWS))
    assert np.isfinite(columns).all()
