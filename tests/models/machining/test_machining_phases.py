from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.machining.machining_phases import (
    Fault,
    Phase,
    PhaseInputs,
    PhasesConfig,
    advance,
    check_phases,
    initial_state,
    setpoint,
    travel_time,
    travelled,
)

CONFIG = PhasesConfig()
CONSTANTS = CONFIG.constants
STEP = 1e-3
CONTACT = CONFIG.standoff / CONFIG.approach_speed + 0.1  # s


def play(force_of, config=CONFIG, work=0.5, room=lambda t: 1.0, end=12.0, trusted=lambda p: True):
    """Phases met, and the fault, with a feedback force(t, phase, set-point)."""
    state, met, t = initial_state(), [Phase.APPROACH], 0.0
    while t < end:
        target = setpoint(config.constants, state, t, 40.0, 40.0, 40.0)
        force = force_of(t, Phase(int(state[0]["phase"])), target)
        t += STEP
        trusts = trusted(Phase(int(state[0]["phase"])))
        inputs = PhaseInputs(STEP, t, force, target, work, room(t), trusts)
        if advance(config.constants, inputs, state):
            met.append(Phase(int(state[0]["phase"])))
    return met, Fault(int(state[0]["fault"]))


def wall(t, phase, target):
    """Contact that holds what is asked for, once the tool has come down."""
    if phase == Phase.APPROACH:
        return max(0.0, 40.0 * (t - CONTACT))
    return target


def test_a_pass_goes_through_its_phases_in_order():
    met, fault = play(wall)
    assert met == list(Phase)[: Phase.DONE + 1]
    assert fault == Fault.NONE


def test_friction_that_starts_to_act_is_no_contact():
    """An estimate jumps when joints start to move, far from the surface."""
    met, fault = play(lambda t, phase, target: 25.0 if phase == Phase.APPROACH else target)
    assert met == [Phase.APPROACH, Phase.RETREAT, Phase.DONE]
    assert fault == Fault.NOTHING_TOUCHED


def test_contact_on_top_of_a_biased_reading_is_seen():
    met, fault = play(lambda t, phase, target: wall(t, phase, target) - 12.0 * (phase == 0))
    assert fault == Fault.NONE
    assert met[1] == Phase.TOUCH


@pytest.mark.parametrize(
    ("force", "room", "fault"),
    [
        (lambda t, p, s: 0.0 if p == Phase.WORK else wall(t, p, s), 1.0, Fault.CONTACT_LOST),
        (lambda t, p, s: 101.0 if p == Phase.WORK else wall(t, p, s), 1.0, Fault.OVER_FORCE),
        (lambda t, p, s: np.nan if p == Phase.WORK else wall(t, p, s), 1.0, Fault.OVER_FORCE),
        (wall, 0.01, Fault.JOINT_LIMIT),
    ],
)
def test_trouble_ends_in_a_retreat(force, room, fault):
    met, fault_found = play(force, work=2.0, room=lambda t: room if t > 5.0 else 1.0)
    assert fault_found == fault
    assert met[-2:] == [Phase.RETREAT, Phase.DONE]


def test_a_moment_without_contact_is_forgiven():
    gap = CONFIG.lost_time - 0.05

    def force(t, phase, target):
        return 0.0 if phase == Phase.WORK and 5.0 < t < 5.0 + gap else wall(t, phase, target)

    assert play(force, work=2.0)[1] == Fault.NONE


def test_the_setpoint_joins_the_force_that_is_there_to_the_path():
    state = initial_state()
    state["phase"], state["since"], state["force_there"] = Phase.TOUCH, 1.0, 7.0
    values = [setpoint(CONSTANTS, state, 1.0 + x, 40.0, 99.0, 55.0) for x in (0.0, 0.5, 1.0, 2.0)]
    np.testing.assert_allclose(values, [7.0, 23.5, 40.0, 40.0])
    state[0]["phase"] = Phase.WORK
    assert setpoint(CONSTANTS, state, 1.5, 40.0, 99.0, 55.0) == 99.0
    state[0]["phase"] = Phase.RELEASE
    values = [setpoint(CONSTANTS, state, 1.0 + x, 40.0, 99.0, 55.0) for x in (0.0, CONFIG.release)]
    np.testing.assert_allclose(values, [55.0, CONFIG.release_force])
    state[0]["phase"] = Phase.LIFT
    assert setpoint(CONSTANTS, state, 1.5, 40.0, 99.0, 55.0) == 0.0


@pytest.mark.parametrize("reading", [0.0, 150.0])
def test_readings_that_are_not_valid_cause_no_retreat(reading):
    """While joints turn round an estimate says anything, or nothing."""

    def force(t, phase, target):
        return reading if phase in (Phase.TOUCH, Phase.WORK) else wall(t, phase, target)

    met, fault = play(force, work=2.0, trusted=lambda phase: False)
    assert fault == Fault.NONE
    assert met == list(Phase)[: Phase.DONE + 1]
    _, fault = play(force, work=2.0)
    assert fault == (Fault.CONTACT_LOST if reading == 0.0 else Fault.OVER_FORCE)


@pytest.mark.parametrize("reading", [301.0, np.nan])
@pytest.mark.parametrize("during", [Phase.APPROACH, Phase.TOUCH, Phase.WORK, Phase.RELEASE])
def test_a_force_beyond_any_stiction_ends_the_pass_in_every_phase(reading, during):
    """Three times the limit of 100 N, or no number at all."""

    def force(t, phase, target):
        return reading if phase == during else wall(t, phase, target)

    met, fault = play(force, work=2.0, trusted=lambda phase: False)
    assert fault == Fault.OVER_FORCE
    assert met[-3:] == [during, Phase.RETREAT, Phase.DONE]


def test_a_joint_at_its_limit_needs_no_feedback():
    met, fault = play(wall, work=2.0, room=lambda t: 0.01 if t > 5.0 else 1.0, trusted=lambda p: 0)
    assert fault == Fault.JOINT_LIMIT
    assert met[-2:] == [Phase.RETREAT, Phase.DONE]


def test_the_time_without_contact_restarts_after_readings_that_are_not_valid():
    """Two gaps that only together are long enough, with an untrusted tick between them."""
    state, met = initial_state(), []
    state[0]["phase"] = Phase.WORK
    gap = round(0.6 * CONFIG.lost_time / STEP)
    for k in range(2 * gap):
        advance(CONSTANTS, PhaseInputs(STEP, k * STEP, 0.0, 40.0, 99.0, 1.0, k != gap), state)
        met.append(int(state[0]["phase"]))
    assert set(met) == {Phase.WORK}


@pytest.mark.parametrize("bias", [-12.0, 0.0, 9.0])
def test_in_the_approach_the_setpoint_is_the_force_beyond_that_of_free_motion(bias):
    """So that force control takes over from what the spring presses with, without a jump."""
    state, t, setpoints = initial_state(), 0.0, []
    while state[0]["phase"] == Phase.APPROACH:
        setpoints.append(setpoint(CONSTANTS, state, t, 40.0, 40.0, 40.0))
        force = bias + wall(t, Phase.APPROACH, 0.0)
        t += STEP
        advance(CONSTANTS, PhaseInputs(STEP, t, force, setpoints[-1], 1.0, 1.0, True), state)
    assert state[0]["phase"] == Phase.TOUCH
    free = round((CONTACT - 0.02) / STEP)
    # The baseline has met the bias by e^-10 and less; a positive one is a force at first.
    np.testing.assert_allclose(setpoints[free - 200 : free], 0.0, atol=0.01)
    assert min(setpoints) >= 0.0
    rise = force - bias
    # What the baseline has followed in the .3 s since contact is missing.
    assert 0.7 * rise < state[0]["force_there"] <= rise + 0.01
    first = setpoint(CONSTANTS, state, t, 40.0, 40.0, 40.0)
    assert first == pytest.approx(state[0]["force_there"])
    # 40 N/s in a tick.
    assert abs(first - setpoints[-1]) < 0.05


@pytest.mark.parametrize(("speed", "distance"), [(0.01, 0.03), (0.5, 0.02)])
def test_travel_is_its_speed_summed_up_and_ends_at_rest(speed, distance):
    end = travel_time(speed, distance)
    t = np.linspace(0.0, end, 4001)
    way, rate = np.array([travelled(x, speed, distance) for x in t]).T
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
    np.testing.assert_allclose(way, summed, atol=1e-6 * distance + 1e-7)
    assert way[-1] == pytest.approx(distance)
    assert rate.max() <= speed * (1 + 1e-12)
    assert travelled(end + 1.0, speed, distance) == (distance, 0.0)


def test_bad_numbers_are_named():
    with pytest.raises(InputError, match=r"phases\.rise"):
        check_phases(replace(CONFIG, rise=0.0), "x")
    with pytest.raises(InputError, match="standoff"):
        check_phases(replace(CONFIG, standoff=CONFIG.search), "x")
