"""The phases of a machining pass: approach, touch, work, release, lift, and the safe retreat.

    APPROACH  under position control, slowly along the inward normal, until the force rises
    TOUCH     force control takes over and brings the force up to the set-point, at rest
    WORK      along the path, with the set-point of the place
    RELEASE   at rest at the end of the path, the force goes down
    LIFT      under position control, out along the normal
    DONE      at rest above the workpiece
    RETREAT   instead of all that: out along the normal, fast; then DONE. Its reason is the fault

The state is one record, so that a controller of any kind can hold it, and the numbers of a
PhasesConfig are one as well (`constants`), for the kernels. All times are of the controller; the
force is that of its force feedback, positive out of the surface.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Record, record, record_type
from wrenchsight.models.numerics.kernel import kernel


class Phase(IntEnum):
    """Phases of a pass, in the order of the module's table."""

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
PHASE_STATE_TYPE = record_type(
    phase=(), since=(), fault=(), baseline=(), above=(), lost=(), force_there=()
)
"""The state of a pass.

    phase        a Phase
    since        s, when it began
    fault        a Fault
    baseline     N, of the force in free motion
    above        s, for which the force has been above touch_force
    lost         s, for which it has been below lost_share of the set-point
    force_there  N above the baseline, from which the touch goes up
"""
RAMP_TIME = 0.15  # s, in which an approach or a lift reaches its speed
# factor of the force limit: at rest an estimate errs by stiction, tens of newtons
_UNTRUSTED_FORCE_RATIO = 3.0
_BASELINE_TIME = (0.15, 1.0)  # s, before and while contact is looked for
_RETREAT_SPEED_RATIO = 2.0  # of lift_speed: a retreat is to be over soon


@dataclass
class PhasesConfig:
    """Distances, speeds, times and forces at which one phase gives way to the next."""

    standoff: float = 0.02
    """m above the surface, where the approach begins"""
    approach_speed: float = 0.008
    """m/s"""
    search: float = 0.008
    """m before and beyond the expected surface, in which contact is looked for"""
    touch_force: float = 6.0
    """N above the reading in free motion: contact"""
    touch_time: float = 0.005
    """s for which it must be above"""
    rise: float = 1.0
    """s, to the set-point"""
    settle: float = 0.5
    """s, at the set-point before the feed starts"""
    release: float = 0.6
    """s, from the set-point down"""
    release_force: float = 3.0
    """N, at which the tool lifts"""
    lift: float = 0.03
    """m"""
    lift_speed: float = 0.04
    """m/s"""
    lost_share: float = 0.15
    """of the set-point; below it contact is lost"""
    lost_time: float = 0.5
    """s for which it must be below"""
    max_force: float = 100.0
    """N"""
    joint_margin: float = 0.02
    """rad or m, from a joint's limit"""

    @property
    def constants(self) -> Record:
        """(1,) these numbers under their names, as kernels read them."""
        return record(**vars(self))


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


def initial_state() -> Record:
    """(1,) of PHASE_STATE_TYPE at the start of the approach."""
    return np.zeros(1, PHASE_STATE_TYPE)


@kernel
def force_controlled(phase: int) -> bool:
    """Whether force is controlled in a phase: from the touch to the release."""
    return bool(Phase.TOUCH <= phase <= Phase.RELEASE)


@kernel
def travelled(t: float, speed: float, distance: float) -> tuple[float, float]:
    """How far (m) and how fast (m/s) t seconds after starting towards `distance`, m.

    The speed rises and falls evenly over RAMP_TIME, or less where the distance is short.
    """
    ramp = min(RAMP_TIME, distance / speed)
    end = distance / speed + ramp
    if t <= 0.0:
        return 0.0, 0.0
    if t < ramp:
        return 0.5 * speed * t * t / ramp, speed * t / ramp
    if t < end - ramp:
        return speed * (t - 0.5 * ramp), speed
    if t < end:
        remaining = end - t
        return distance - 0.5 * speed * remaining * remaining / ramp, speed * remaining / ramp
    return distance, 0.0


@kernel
def travel_time(speed: float, distance: float) -> float:
    """Seconds until `travelled` is at its end."""
    return distance / speed + min(RAMP_TIME, distance / speed)


@kernel
def outward_travel(phases: Record, state: Record, t: float) -> tuple[float, float]:
    """How far (m) and how fast (m/s) out of the surface, where force is not controlled.

    Args:
        phases: PhasesConfig.constants.
    """
    phase, since = int(state[0].phase), t - state[0].since
    if phase == Phase.APPROACH:
        distance, speed = travelled(
            since, phases[0].approach_speed, phases[0].standoff + phases[0].search
        )
        return -distance, -speed
    if phase == Phase.LIFT:
        return travelled(since, phases[0].lift_speed, phases[0].lift)
    if phase == Phase.RETREAT:
        return travelled(since, _RETREAT_SPEED_RATIO * phases[0].lift_speed, phases[0].lift)
    return phases[0].lift, 0.0


@kernel
def work_time(state: Record, t: float, duration: float) -> float:
    """Seconds since the feed started: 0 before, the whole `duration` (s) after."""
    phase = int(state[0].phase)
    if phase == Phase.WORK:
        return float(min(t - state[0].since, duration))
    return 0.0 if phase <= Phase.TOUCH else duration


@kernel
def setpoint(
    phases: Record, state: Record, t: float, at_start: float, at_place: float, at_end: float
) -> float:
    """The set-point of the normal force, N; in the approach the force that is read.

    Args:
        phases: PhasesConfig.constants.
        at_start, at_place, at_end: N, of the path: at its start, at this place, at its end.
    """
    phase, since = int(state[0].phase), t - state[0].since
    if phase == Phase.APPROACH:
        return float(state[0].force_there)
    if phase == Phase.TOUCH:
        share = min(1.0, since / phases[0].rise)
        share = share * share * (3.0 - 2.0 * share)
        start = min(state[0].force_there, at_start)
        return float(start + share * (at_start - start))
    if phase == Phase.WORK:
        return at_place
    if phase == Phase.RELEASE:
        share = min(1.0, since / phases[0].release)
        return float(at_end + share * (min(phases[0].release_force, at_end) - at_end))
    return 0.0


class PhaseInputs(NamedTuple):
    """The quantities of one tick that decide on the next phase.

    Attributes:
        time_step: s.
        t: s, the end of the tick.
        force: N, of the feedback, out of the surface.
        setpoint: N, of this force.
        work_duration: s, along the path and back.
        joint_room: smallest distance of a joint from its limits, rad or m.
        is_trusted: whether the feedback can be used now. Else it never reports a lost contact, and
            only a force of _UNTRUSTED_FORCE_RATIO times the limit is too high.
    """

    time_step: float
    t: float
    force: float
    setpoint: float
    work_duration: float
    joint_room: float
    is_trusted: bool


@kernel
def advance(phases: Record, inputs: PhaseInputs, state: Record) -> bool:
    """Takes one tick, changing `state` in place; returns whether the phase has changed.

    APPROACH, TOUCH, WORK, RELEASE and LIFT follow one another, then DONE; a fault leads from any of
    the first four to RETREAT. At most one change is made a tick. A change writes
    phase and since, and sets above and lost to 0.

    Args:
        phases: PhasesConfig.constants.
        inputs: of the tick.
        state: (1,) of PHASE_STATE_TYPE, changed.
    """
    time_step, t, force, is_trusted = inputs.time_step, inputs.t, inputs.force, inputs.is_trusted
    phase = int(state[0].phase)
    since = t - state[0].since
    if phase == Phase.DONE:
        return False
    if phase in (Phase.LIFT, Phase.RETREAT):
        speed = phases[0].lift_speed * (_RETREAT_SPEED_RATIO if phase == Phase.RETREAT else 1.0)
        if since < travel_time(speed, phases[0].lift):
            return False
        return _enter(state, Phase.DONE.value, t)
    bound = phases[0].max_force * (1.0 if is_trusted else _UNTRUSTED_FORCE_RATIO)
    if not force <= bound:  # true for NaN as well
        return _retreat(state, Fault.OVER_FORCE.value, t)
    if inputs.joint_room < phases[0].joint_margin:
        return _retreat(state, Fault.JOINT_LIMIT.value, t)
    if phase == Phase.APPROACH:
        # The reading in free motion is not contact: an estimate jumps by the friction of joints
        # that start to move. The baseline follows it fast before contact is possible, and slowly
        # afterwards (is_near), as contact rises faster. The surface may lie SEARCH nearer than the
        # task states, which is STANDOFF from the start, or SEARCH farther.
        rise = force - state[0].baseline
        whole_way = phases[0].standoff + phases[0].search
        travelled_way = travelled(since, phases[0].approach_speed, whole_way)[0]
        is_near = travelled_way >= phases[0].standoff - phases[0].search
        is_touching = is_near and rise > phases[0].touch_force
        state[0].above = state[0].above + time_step if is_touching else 0.0
        state[0].baseline += time_step / _BASELINE_TIME[int(is_near)] * rise
        state[0].force_there = max(0.0, force - state[0].baseline)  # of this tick
        if state[0].above >= phases[0].touch_time:
            return _enter(state, Phase.TOUCH.value, t)
        if since >= travel_time(phases[0].approach_speed, whole_way):
            return _retreat(state, Fault.NOTHING_TOUCHED.value, t)
        return False
    # While the force comes up there is no contact to lose, nor while it goes down.
    is_in_contact = phase == Phase.WORK or (phase == Phase.TOUCH and since > phases[0].rise)
    is_lost = is_in_contact and is_trusted and force < phases[0].lost_share * inputs.setpoint
    state[0].lost = state[0].lost + time_step if is_lost else 0.0
    if state[0].lost >= phases[0].lost_time:
        return _retreat(state, Fault.CONTACT_LOST.value, t)
    if phase == Phase.TOUCH:
        duration = phases[0].rise + phases[0].settle
    elif phase == Phase.WORK:
        duration = inputs.work_duration
    else:
        duration = phases[0].release
    if since >= duration:
        return _enter(state, phase + 1, t)
    return False


@kernel
def _enter(state: Record, phase: int, t: float) -> bool:
    """Begins a phase at time t, s; returns True: the phase has changed."""
    state[0].phase, state[0].since = phase, t
    state[0].above = state[0].lost = 0.0
    return True


@kernel
def _retreat(state: Record, fault: int, t: float) -> bool:
    """Begins a retreat for a Fault; returns True as `_enter`."""
    state[0].fault = fault
    return _enter(state, Phase.RETREAT.value, t)
