"""Corrections of signals that need more than one sample, or the robot: delays, missing gravity.

A signal that is late by d holds at t + d what belongs to t. It is interpolated there. Samples at
the begin or the end of the log for which there is none are left out.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.recording import Recording, concatenated
from wrenchsight.models.recordings.recording_format import ColumnLayout
from wrenchsight.models.robot.robot import Robot


def corrected_chunks(
    chunks: Iterator[Recording],
    layout: ColumnLayout,
    robot: Robot | None,
    gravity_torque: Callable[[Array], Array] | None,
) -> Iterator[Recording]:
    """The parts of a log with the corrections of its layout, and the offsets of joints' zeros.

    A signal that is `delay` s late is moved to the times at which it was, a joint's part of it by
    its own `joint_delay` beside that, and a torque or current without gravity gains that of the
    posture. What the log does not hold, velocities made of q and currents made of torque, is late
    with these and lacks gravity with these; what it does hold has its own corrections alone.

    Args:
        chunks: successive parts of one recording.
        layout: signals with their corrections.
        robot: whose zeros count; None: the log's own.
        gravity_torque: (N, n) N m of postures (N, n); None: that of the robot's own files.

    Raises:
        InputError: the gravity torque of a robot without inertias is asked for.
    """
    delays = {signal.name: signal.delays for signal in layout.signals if signal.delays.any()}
    lacks_gravity = {signal.name for signal in layout.signals if signal.without_gravity}
    if layout.signal("v") is None and "q" in delays:  # differentiated
        delays["v"] = delays["q"]
    if layout.signal("current") is None:  # made of the torque
        if "tau_J" in delays:
            delays["current"] = delays["tau_J"]
        if "tau_J" in lacks_gravity:
            lacks_gravity.add("current")
    if lacks_gravity and robot is not None and gravity_torque is None:
        robot.require_inertias("without_gravity")
        gravity_torque = robot.chain.gravity_torque
    for chunk in _without_delays(chunks, delays) if delays else chunks:
        if robot is not None and chunk.num_joints and robot.q_offset.any():
            chunk = replace(chunk, q=chunk.q + robot.q_offset)
        if lacks_gravity and robot is not None and gravity_torque is not None:
            # Of the true posture, so with the offsets of the zeros.
            gravity = gravity_torque(np.ascontiguousarray(chunk.q))
            if "current" in lacks_gravity:
                chunk = replace(chunk, current=chunk.current + robot.motor_current(gravity))
            if "tau_J" in lacks_gravity and chunk.tau_J is not None:
                chunk = replace(chunk, tau_J=chunk.tau_J + gravity)
        yield chunk


def _without_delays(chunks: Iterator[Recording], delays: dict[str, Array]) -> Iterator[Recording]:
    """The parts of a log, each signal at its own time; delays (k,) of its columns in s."""
    all_delays = np.concatenate(list(delays.values()))
    latest = all_delays.max(initial=0.0)
    earliest = all_delays.min(initial=0.0)
    kept: Recording | None = None
    begin = -np.inf  # of the samples that are still to come
    for chunk in chunks:
        kept = chunk if kept is None else concatenated([kept, chunk])
        if begin == -np.inf:
            begin = kept.t[0] - earliest
        is_ready = (kept.t >= begin) & (kept.t <= kept.t[-1] - latest)
        if is_ready.any():
            yield _at_own_times(kept, is_ready, delays)
            begin = np.nextafter(kept.t[is_ready][-1], np.inf)
        kept = kept[kept.t >= begin + earliest - 2.0 * _step(kept)]


def _step(chunk: Recording) -> float:
    return float(np.median(np.diff(chunk.t))) if chunk.num_samples > 1 else 0.0


def _at_own_times(kept: Recording, is_ready: Flags, delays: dict[str, Array]) -> Recording:
    part = kept[is_ready]
    changed: dict[str, Any] = {}
    for name, of_columns in delays.items():
        signal = getattr(kept, name)
        if signal is not None:
            columns = [
                np.interp(part.t + delay, kept.t, x)
                for delay, x in zip(of_columns, signal.T, strict=True)
            ]
            changed[name] = np.stack(columns, axis=1)
    return replace(part, **changed)
