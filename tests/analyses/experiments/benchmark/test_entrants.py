"""Estimators of others in the benchmark: what they are given, and what is told of their faults."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from wrenchsight.analyses.experiments.benchmark import entrants
from wrenchsight.analyses.experiments.benchmark.arm import CurrentLog, by_estimator
from wrenchsight.analyses.experiments.benchmark.entrants import (
    Entrant,
    FaultError,
    motor_torque,
    reader_of,
    touched_link,
    wrench_of_torque,
)
from wrenchsight.analyses.study.own_methods import MethodEntry
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers import observer_kinds
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig
from wrenchsight.models.observers.momentum_observer import (
    MomentumObserver,
    MomentumObserverConfig,
)

N, STEP = 60, 0.01


@pytest.fixture(scope="module")
def log(ur10e):
    t = STEP * np.arange(N)
    q = np.asarray(ur10e.home) + 0.1 * np.sin(t)[:, None]
    v = 0.1 * np.cos(t)[:, None] + np.zeros_like(q)
    every = np.ones(N, bool)
    return CurrentLog("made up", t, q, v, np.ones_like(q), None, np.full(6, 1e-5), every, STEP)


@pytest.fixture(scope="module")
def model(ur10e):
    return IdentifiedModel.nominal(ur10e)


def test_a_callable_s_wrench_is_read_as_it_returns_it(log, ur10e, model):
    wrench = np.arange(6.0 * N).reshape(N, 6)
    covariance = np.tile(np.diag(np.arange(1.0, 7.0)), (N, 1, 1))

    def theirs(q, v, current):
        for signal, given in zip((q, v, current), (log.q, log.v, log.current), strict=True):
            np.testing.assert_array_equal(signal, given)
        return wrench, covariance

    reading = reader_of(theirs, ur10e, model, STEP)(log)
    np.testing.assert_array_equal(reading.wrench, wrench)
    np.testing.assert_array_equal(reading.covariance, covariance)
    assert reading.tau_ext is None
    stated = reader_of(lambda q, v, current: (wrench, None), ur10e, model, STEP)(log)
    assert stated.covariance is None


def test_a_method_cannot_change_the_log_that_it_reads(log, ur10e, model):
    before = log.q.copy()

    def spoils(q, v, current):
        q[:] = np.nan
        return np.zeros((N, 6)), None

    reader_of(spoils, ur10e, model, STEP)(log)
    np.testing.assert_array_equal(log.q, before)


def test_an_observer_s_configuration_reads_with_the_model(log, ur10e, model):
    config = KalmanObserverConfig(time_step=STEP)
    reading = reader_of(config, ur10e, model, STEP)(log)
    expected = by_estimator(log, ur10e, model, observer=config)
    np.testing.assert_array_equal(reading.wrench, expected.wrench)
    with pytest.raises(FaultError, match=r"0.001 s, the logs have 0.01 s: take MethodSetting"):
        reader_of(KalmanObserverConfig(), ur10e, model, STEP)


@dataclass
class PlainConfig:
    """Without the settings that other kinds have."""

    time_step: float = STEP


class PlainObserver(MomentumObserver):
    Config = PlainConfig

    def __init__(self, config, num_joints):
        super().__init__(MomentumObserverConfig(time_step=config.time_step), num_joints)


def test_an_observer_of_another_kind_keeps_its_own_settings(log, ur10e, model, monkeypatch):
    monkeypatch.setattr(observer_kinds, "OBSERVERS", [*observer_kinds.OBSERVERS, PlainObserver])
    reading = reader_of(PlainConfig(), ur10e, model, STEP)(log)
    expected = by_estimator(log, ur10e, model, observer=MomentumObserverConfig(time_step=STEP))
    np.testing.assert_array_equal(reading.wrench, expected.wrench)
    jumping = replace(log, v=np.where(np.arange(N)[:, None] == 30, 2.0, log.v))
    assert not np.array_equal(
        by_estimator(jumping, ur10e, model).wrench,
        by_estimator(replace(jumping, is_rebuilt=True), ur10e, model).wrench,
    )


def _spoilt(value, row=3):
    wrench = np.zeros((N, 6))
    wrench[row] = value
    return wrench


_UNEVEN = np.tile(np.triu(np.ones((6, 6))), (N, 1, 1))


@pytest.mark.parametrize(
    ("returned", "words"),
    [
        (None, "expected a wrench and its covariance (or None), found NoneType"),
        (np.zeros((N, 6)), "expected a wrench and its covariance (or None), found ndarray"),
        ((np.zeros((N, 3)), None), f"wrench: expected shape ({N}, 6), found ({N}, 3)"),
        ((np.zeros((N - 1, 6)), None), f"found ({N - 1}, 6)"),
        (("force", None), f"wrench: expected numbers of shape ({N}, 6), found str"),
        ((_spoilt(np.nan), None), f"wrench: not finite in 1 of {N} rows, the first is row 3"),
        ((_spoilt(np.inf), None), "wrench: not finite"),
        ((np.zeros((N, 6)), np.zeros((6, 6))), f"covariance: expected shape ({N}, 6, 6)"),
        ((np.zeros((N, 6)), np.full((N, 6, 6), np.nan)), "covariance: not finite"),
        ((np.zeros((N, 6)), -np.tile(np.eye(6), (N, 1, 1))), "variances of zero or more"),
        ((np.zeros((N, 6)), _UNEVEN), "symmetric"),
    ],
)
def test_a_wrong_return_is_one_line(log, ur10e, model, returned, words):
    with pytest.raises(FaultError) as fault:
        reader_of(lambda q, v, current: returned, ur10e, model, STEP)(log)
    assert words in str(fault.value) and "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ValueError("no\nsecond line"), "ValueError: no"),
        (ZeroDivisionError(), "ZeroDivisionError"),
        (SystemExit(1), "SystemExit: 1"),
    ],
)
def test_an_exception_is_one_line(log, ur10e, model, error, words, monkeypatch):
    def fails(*_):
        raise error

    entrant = Entrant(MethodEntry("theirs", "absent", "make"))
    monkeypatch.setattr(MethodEntry, "load", lambda entry: fails)
    for call in (
        lambda: reader_of(fails, ur10e, model, STEP)(log),
        lambda: entrant.made("load", ur10e, model, (), STEP),
    ):
        with pytest.raises(FaultError) as fault:
            call()
        assert str(fault.value).endswith(words)


def test_an_interrupt_is_no_fault(log, ur10e, model):
    def interrupted(q, v, current):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reader_of(interrupted, ur10e, model, STEP)(log)


def test_an_object_that_is_no_estimator_is_refused_by_name(ur10e, model):
    with pytest.raises(FaultError, match="it returned int, expected an observer's configuration"):
        reader_of(3, ur10e, model, STEP)


class _Theirs:
    def torque(self, q, v):
        return 2.0 * q

    def wrench_of_torque(self, J, tau_ext):
        return np.zeros((len(J), 6)), None

    def touched_link(self, t, tau_ext, J):
        return np.full(len(t), 8)


def test_further_methods_are_checked_alike(log):
    theirs, J = _Theirs(), np.zeros((N, 6, 6))
    np.testing.assert_array_equal(motor_torque(theirs, log.q, log.v), 2.0 * log.q)
    assert wrench_of_torque(theirs, J, log.q).wrench.shape == (N, 6)
    with pytest.raises(FaultError, match="link: expected whole numbers from 0 to 6"):
        touched_link(theirs, log.t, log.q, J)
    without = object()
    assert motor_torque(without, log.q, log.v) is None
    assert wrench_of_torque(without, J, log.q) is None
    assert touched_link(without, log.t, log.q, J) is None
    assert entrants.checked("x", [1, 2], (2,)).dtype == float
