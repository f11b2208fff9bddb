"""Estimators of others in the benchmark: makes them, calls them with copies, checks their values.

Whatever a method does wrong becomes a `FaultError` with one line, which marks its column.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.benchmark.arm import MethodReading, Reader, by_estimator
from wrenchsight.analyses.study.own_methods import MethodEntry, MethodSetting, reason_of
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.observer_kinds import kind_of
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

_SYMMETRY_TOLERANCE = 1e-6  # relative, of a covariance


class FaultError(Exception):
    """A method failed, or returned something else than expected; one line."""


@dataclass(frozen=True, eq=False)
class Entrant:
    """A method of others.

    Attributes:
        entry: as it was named.
    """

    entry: MethodEntry

    @property
    def name(self) -> str:
        """The name of its column."""
        return self.entry.name

    def made(
        self,
        task: str,
        robot: Robot,
        model: IdentifiedModel,
        free_logs: tuple[Recording, ...],
        time_step: float,
    ) -> Any:
        """What the method's function returns for a task; arguments as `MethodSetting`.

        Raises:
            FaultError: the function fails.
        """
        setting = MethodSetting(task, robot, model, free_logs, time_step)
        return _called(self.entry.function, self.entry.load(), setting)


def reader_of(made: Any, robot: Robot, model: IdentifiedModel, time_step: float) -> Reader:
    """Makes the reader of logs from what a method's function returned.

    Raises:
        FaultError: that is neither an observer's configuration nor a callable, or the observer is
            for other samples.
    """
    if kind_of(made) is not None:
        observer_step = made.time_step
        if abs(observer_step - time_step) > 1e-9:
            steps = f"time_step is {observer_step:g} s, the logs have {time_step:g} s"
            raise FaultError(f"{type(made).__name__}.{steps}: take MethodSetting.time_step")
        return lambda log: _called("observer", by_estimator, log, robot, model, observer=made)
    if not callable(made):
        problem = f"it returned {type(made).__name__}, expected an observer's configuration"
        raise FaultError(f"{problem}, a callable of q, v and current, or None")
    return lambda log: _reading("wrench of q, v and current", made, log.q, log.v, log.current)


def wrench_of_torque(made: Any, J: Array, tau_ext: Array) -> MethodReading | None:
    """Its wrench from joint torque (N, n) with J (N, 6, n); None: it has no such method.

    Raises:
        FaultError: it fails, or returns something else.
    """
    method = getattr(made, "wrench_of_torque", None)
    return None if method is None else _reading("wrench_of_torque", method, J, tau_ext)


def motor_torque(made: Any, q: Array, v: Array) -> Array | None:
    """(N, n) N m, the motor torque that it predicts; None: it has no such method.

    Raises:
        FaultError: it fails, or returns something else.
    """
    method = getattr(made, "torque", None)
    if method is None:
        return None
    return checked("torque", _called("torque", method, *_copies(q, v)), q.shape)


def touched_link(made: Any, t: Array, tau_ext: Array, J: Array) -> Array | None:
    """(N,) the link that it names as touched, 0: none; None: it has no such method.

    Raises:
        FaultError: it fails, or returns something else.
    """
    method = getattr(made, "touched_link", None)
    if method is None:
        return None
    link = checked("link", _called("touched_link", method, *_copies(t, tau_ext, J)), t.shape)
    n = tau_ext.shape[1]
    if not (np.isin(link, np.arange(n + 1))).all():
        raise FaultError(f"link: expected whole numbers from 0 to {n}")
    return link


def checked(quantity: str, value: Any, shape: tuple[int, ...]) -> Array:
    """The value as finite numbers of a shape.

    Raises:
        FaultError: it is something else.
    """
    try:
        array = np.array(value, float)
    except (TypeError, ValueError):
        kind = f"found {type(value).__name__}"
        raise FaultError(f"{quantity}: expected numbers of shape {shape}, {kind}") from None
    if array.shape != shape:
        raise FaultError(f"{quantity}: expected shape {shape}, found {array.shape}")
    bad = np.flatnonzero(~np.isfinite(array.reshape(len(array), -1)).all(axis=1))
    if len(bad):
        where = f"{len(bad)} of {len(array)} rows, the first is row {bad[0]}"
        raise FaultError(f"{quantity}: not finite in {where}")
    return array


def _reading(call: str, method: Callable[..., Any], *signals: Array) -> MethodReading:
    value = _called(call, method, *_copies(*signals))
    if not isinstance(value, tuple | list) or len(value) != 2:
        problem = f"{call}: expected a wrench and its covariance (or None)"
        raise FaultError(f"{problem}, found {type(value).__name__}")
    wrench, covariance = value
    N = len(signals[0])
    wrench = checked("wrench", wrench, (N, 6))
    if covariance is None:
        return MethodReading(wrench)
    covariance = checked("covariance", covariance, (N, 6, 6))
    largest = np.abs(covariance).max(axis=(1, 2), keepdims=True)
    uneven = np.abs(covariance - covariance.transpose(0, 2, 1)) > _SYMMETRY_TOLERANCE * largest
    if uneven.any() or (np.diagonal(covariance, axis1=1, axis2=2) < 0.0).any():
        raise FaultError("covariance: expected symmetric matrices with variances of zero or more")
    return MethodReading(wrench, covariance)


def _copies(*signals: Array) -> list[Array]:
    """Copies that a method of others may change."""
    return [signal.copy() for signal in signals]


def _called(call: str, method: Callable[..., Any], *arguments: Any, **words: Any) -> Any:
    try:
        return method(*arguments, **words)
    except (Exception, SystemExit) as error:
        raise FaultError(f"{call}: {reason_of(error)}") from error
