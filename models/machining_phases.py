"""The phases of a machining pass: approach, touch, work, release, lift, and the safe retreat.

    APPROACH  under position control, slowly along the inward normal, until the force rises
    TOUCH     force control takes over and brings the force up to the set-point, at rest
    WORK      along the path, with the set-point of the place
    RELEASE   at rest at the end of the path, the force goes down
    LIFT      under position control, out along the normal
    DONE      at rest above the workpiece
    RETREAT   instead of all that: out along the normal, fast; then DONE. Its reason is the fault

The state is one (7,) array, so that a controller of any kind can hold it. All times are of the
controller; the force is what its force feedback says, positive out of the surface.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from models.input_error import InputError

Array = NDArray[np.float64]


class Phase(IntEnum):
    """See the module."""

    APPROACH = 0
    TOUCH = 1
    WORK = 2
    RELEASE = 3
    LIFT = 4
    DONE = 5
    RETREAT = 6


class Fault(IntEnum):
    """Why a pass ended in a retreat."""

    NONE = 0
    CONTACT_LOST = 1
    OVER_FORCE = 2
    JOINT_LIMIT = 3
    NOTHING_TOUCHED = 4


FAULT_SENTENCES = {
    Fault.CONTACT_LOST: "contact was lost",
    Fault.OVER_FORCE: "the force exceeded its limit",
    Fault.JOINT_LIMIT: "a joint came to its limit",
    Fault.NOTHING_TOUCHED: "the approach met nothing",
}
FORCE_CONTROLLED = (Phase.TOUCH, Phase.WORK, Phase.RELEASE)

PHASE, SINCE, FAULT, BASELINE, ABOVE, LOST, FORCE_THERE = range(7)  # entries of the state
STATE_SIZE = 7
RAMP = 0.15  # s, in which an approach or a lift reaches its speed
_BASELINE_TIME = (0.15, 1.0)  # s, before and while contact is looked for


@dataclass
class PhasesConfig:
    """When one phase gives way to the next."""

    standoff: float = 0.02  # m above the surface, where the approach begins
    approach_speed: float = 0.008  # m/s
    search: float = (
        0.008  # m before and beyond the expected surface, in which contact is looked for
    )
    touch_force: float = 6.0  # N above what free motion reads: contact
    touch_time: float = 0.005  # s for which it must be above
    rise: float = 1.0  # s, to the set-point
    settle: float = 0.5  # s, at the set-point before the feed starts
    release: float = 0.6  # s, from the set-point down
    release_force: float = 3.0  # N, at which the tool lifts
    lift: float = 0.03  # m
    lift_speed: float = 0.04  # m/s
    lost_share: float = 0.15  # of the set-point; below it contact is lost
    lost_time: float = 0.5  # s for which it must be below
    max_force: float = 100.0  # N
    joint_margin: float = 0.02  # rad or m, from a joint's limit


def check_phases(config: PhasesConfig, source: str) -> None:
    """Raises InputError, naming `source`, for a number out of range."""
    for name, value in vars(config).items():
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(source, f"phases.{name}", f"{value:g}, expected more than 0")
    if config.standoff <= config.search:
        raise InputError(
            source,
            "phases.standoff",
            f"{config.standoff:g} m lies within the search for contact, {config.search:g} m",
            "start farther away, or search less",
        )


def initial_state() -> Array:
    """The state (7,) at the start of the approach."""
    return np.zeros(STATE_SIZE)


def travelled(t: float, speed: float, distance: float) -> tuple[float, float]:
    """How far (m) and how fast (m/s) t seconds after starting towards `distance`, m.

    The speed rises and falls evenly over RAMP, or less where the distance is short.
    """
    ramp = min(RAMP, distance / speed)
    end = distance / speed + ramp
    if t <= 0.0:
        return 0.0, 0.0
    if t < ramp:
        return 0.5 * speed * t * t / ramp, speed * t / ramp
    if t < end - ramp:
        return speed * (t - 0.5 * ramp), speed
    if t < end:
        left = end - t
        return distance - 0.5 * speed * left * left / ramp, speed * left / ramp
    return distance, 0.0


def travel_time(speed: float, distance: float) -> float:
    """Seconds until `travelled` is at its end."""
    return distance / speed + min(RAMP, distance / speed)


def setpoint(
    config: PhasesConfig, state: Array, t: float, at_start: float, here: float, at_end: float
) -> float:
    """The normal force to press with, N.

    Args:
        at_start, here, at_end: of the path: where it begins, at this place, where it ends, N.
    """
    phase, since = int(state[PHASE]), t - float(state[SINCE])
    if phase == Phase.TOUCH:
        share = min(1.0, since / config.rise)
        share = share * share * (3.0 - 2.0 * share)
        start = min(max(float(state[FORCE_THERE]), 0.0), at_start)
        return start + share * (at_start - start)
    if phase == Phase.WORK:
        return here
    if phase == Phase.RELEASE:
        share = min(1.0, since / config.release)
        return at_end + share * (min(config.release_force, at_end) - at_end)
    return 0.0


def advance(
    config: PhasesConfig,
    state: Array,
    time_step: float,
    t: float,
    force: float,
    setpoint_now: float,
    work_duration: float,
    joint_room: float,
) -> bool:
    """Takes one tick, changing `state` in place; returns whether the phase has changed.

    Args:
        time_step: s.
        t: s, the end of the tick.
        force: N, of the feedback, out of the surface.
        setpoint_now: N, that this force should be.
        work_duration: s, along the path and back.
        joint_room: smallest distance of a joint from its limits, rad or m.
    """
    phase = Phase(int(state[PHASE]))
    since = t - state[SINCE]
    if phase in (Phase.DONE, Phase.LIFT, Phase.RETREAT):
        if phase != Phase.DONE and since >= travel_time(
            config.lift_speed * (2.0 if phase == Phase.RETREAT else 1.0), config.lift
        ):
            return _enter(state, Phase.DONE, t)
        return False
    if not np.isfinite(force) or force > config.max_force:
        return _retreat(state, Fault.OVER_FORCE, t)
    if joint_room < config.joint_margin:
        return _retreat(state, Fault.JOINT_LIMIT, t)
    if phase == Phase.APPROACH:
        # What free motion reads is no contact: an estimate jumps by the friction of joints that
        # start to move. It is followed fast before contact can be, slowly after: contact is faster.
        rise = force - state[BASELINE]
        way = travelled(since, config.approach_speed, config.standoff + config.search)[0]
        near = way >= config.standoff - config.search
        above = near and rise > config.touch_force
        state[ABOVE] = state[ABOVE] + time_step if above else 0.0
        state[BASELINE] += time_step / _BASELINE_TIME[int(near)] * rise
        if state[ABOVE] >= config.touch_time:
            state[FORCE_THERE] = force
            return _enter(state, Phase.TOUCH, t)
        if since >= travel_time(config.approach_speed, config.standoff + config.search):
            return _retreat(state, Fault.NOTHING_TOUCHED, t)
        return False
    ready = phase == Phase.WORK or (phase == Phase.TOUCH and since > config.rise)
    lost = ready and force < config.lost_share * setpoint_now
    state[LOST] = state[LOST] + time_step if lost else 0.0
    if state[LOST] >= config.lost_time:
        return _retreat(state, Fault.CONTACT_LOST, t)
    length = {
        Phase.TOUCH: config.rise + config.settle,
        Phase.WORK: work_duration,
        Phase.RELEASE: config.release,
    }[phase]
    if since >= length:
        return _enter(state, Phase(phase + 1), t)
    return False


def _enter(state: Array, phase: Phase, t: float) -> bool:
    state[PHASE], state[SINCE], state[ABOVE], state[LOST] = float(phase), t, 0.0, 0.0
    return True


def _retreat(state: Array, fault: Fault, t: float) -> bool:
    state[FAULT] = float(fault)
    return _enter(state, Phase.RETREAT, t)
