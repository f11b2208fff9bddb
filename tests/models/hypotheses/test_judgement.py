"""What is wrong with a log is named, at large odds; what is right with it is left alone.

The oracle is pinocchio's torque of the bundled UR10e, with friction of the test's own. Each way in
which a log can be wrong is done to that log; what the judgement then says is followed literally.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy.ndimage import uniform_filter1d

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.hypotheses import joint_time, judgement, lasting_force
from wrenchsight.models.hypotheses.case import Case, FittedView
from wrenchsight.models.hypotheses.evidence import Fit
from wrenchsight.models.hypotheses.explanation import Explanation
from wrenchsight.models.hypotheses.judgement import (
    Judgement,
    judge_log,
    stands_beside_contact,
)
from wrenchsight.models.identification.identified_model import (
    BaseParameterTable,
    IdentifiedModel,
    LogSource,
    Provenance,
)
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot

STEP, DURATION = 0.02, 24.0  # s
COULOMB = np.array([8.0, 8.5, 6.0, 2.0, 2.2, 1.9])  # N m
RATE = 2.0 * np.pi * np.array([0.11, 0.13, 0.17, 0.19, 0.23, 0.29])  # rad/s
CENTRE = np.array([0.0, -0.8, 1.0, -0.5, 1.0, 0.0])  # rad
GRAVITY = np.array([0.0, 0.0, -9.81])
TURN = 2.0 * np.pi  # rad
MOMENTS = ("mcx", "mcy", "mcz")  # of a link, as a model.yaml names them


def motion(
    robot: Robot, gravity: np.ndarray = GRAVITY, force: np.ndarray | None = None
) -> Recording:
    """An arm that swings about a posture out of which gravity pulls.

    Args:
        force: (3,) or (T, 3) N, of the environment on E, in W.
    """
    t = np.arange(0.0, DURATION, STEP)
    angle = t[:, None] * RATE
    q, v, vdot = (
        CENTRE + 0.7 * np.sin(angle),
        0.7 * RATE * np.cos(angle),
        -0.7 * RATE**2 * np.sin(angle),
    )
    model = pin.buildModelFromXML(robot.urdf_text)
    model.gravity.linear = gravity
    model.armature = robot.reflected_inertia
    data = model.createData()
    tau = np.array([pin.rnea(model, data, *row) for row in zip(q, v, vdot, strict=True)])
    tau += COULOMB * np.tanh(v / 0.01)
    if force is not None:
        tau -= np.einsum(
            "tij,ti->tj", robot.chain.jacobian(q)[:, 3:], np.broadcast_to(force, (len(t), 3))
        )
    rng = np.random.default_rng(5)
    tau += 0.02 * COULOMB * rng.normal(size=tau.shape)
    return Recording(t, q, v, robot.motor_current(tau), "log.csv")


def judged(log: Recording, robot: Robot) -> Judgement:
    judgement = judge_log([log], robot, None)
    assert judgement is not None
    return judgement


def later(log: Recording, delay: float) -> Recording:
    """The log with currents that are late by `delay` s."""
    current = np.stack([np.interp(log.t - delay, log.t, x) for x in log.current.T], axis=1)
    return replace(log, current=current)


def averaged(log: Recording, window: float) -> Recording:
    """The log with currents averaged over the last `window` s."""
    size = round(window / STEP)
    total = np.cumsum(np.vstack([np.repeat(log.current[:1], size, axis=0), log.current]), axis=0)
    return replace(log, current=(total[size:] - total[:-size]) / size)


def turned(x: np.ndarray, *joints: int) -> np.ndarray:
    sign = np.ones(6)
    sign[list(joints)] = -1.0
    return x * sign


DAMAGES: dict[str, tuple[str, Callable[[Recording, Robot], Recording]]] = {
    "currents by name": (
        "order of the drives",
        lambda log, robot: replace(log, current=log.current[:, [2, 1, 0, 3, 4, 5]]),
    ),
    "currents from tool to base": (
        "order of the drives",
        lambda log, robot: replace(log, current=log.current[:, ::-1]),
    ),
    "currents in a ring": (
        "order of the drives",
        lambda log, robot: replace(log, current=np.roll(log.current, 1, axis=1)),
    ),
    "positions exchanged": (
        "order of the joints",
        lambda log, robot: replace(
            log, q=log.q[:, [0, 2, 1, 3, 4, 5]], v=log.v[:, [0, 2, 1, 3, 4, 5]]
        ),
    ),
    "elbow's current turned": (
        "signs of the drives",
        lambda log, robot: replace(log, current=turned(log.current, 2)),
    ),
    "all currents turned": (
        "signs of the drives",
        lambda log, robot: replace(log, current=-log.current),
    ),
    "lift counts the other way": (
        "signs of the joints",
        lambda log, robot: replace(log, q=turned(log.q, 1), v=turned(log.v, 1)),
    ),
    "revolutions": (
        "unit of the positions",
        lambda log, robot: replace(log, q=log.q / TURN, v=log.v / TURN),
    ),
    "positions of another gear": (
        "unit of the positions",
        lambda log, robot: replace(log, q=0.6 * log.q, v=0.6 * log.v),
    ),
    "currents late": ("time of the drives", lambda log, robot: later(log, 0.2)),
    "currents early": ("time of the drives", lambda log, robot: later(log, -0.3)),
    "gravity missing": (
        "gravity missing from the effort",
        lambda log, robot: replace(
            log, current=log.current - robot.motor_current(robot.chain.gravity_torque(log.q))
        ),
    ),
}


def test_an_effort_below_any_friction_is_not_torque_without_gravity(ur10e: Robot) -> None:
    log = motion(ur10e)
    # rad: by how much joints miss their reference, whatever loads them
    error = 0.01 * np.sin(1.3 * log.t[:, None] + np.arange(6.0))
    judgement = judged(replace(log, tau_J=error), ur10e)
    assert judgement.fault is not None, judgement.log_odds
    assert "a quantity that is no torque of the drives" in judgement.sentence()
    assert "effort-without-gravity" not in judgement.sentence()


def test_a_position_error_that_follows_the_velocity_is_no_torque_a_thousand_times_too_small(
    ur10e: Robot,
) -> None:
    """Links without mass would need such a torque; one in kN m follows their weight."""
    log = motion(ur10e)
    fault = judged(replace(log, tau_J=0.01 * np.tanh(log.v)), ur10e).fault
    assert fault is not None
    assert fault.name == "no torque of the drives"
    in_kilonewton_metres = 1e-3 * ur10e.joint_torque(log.current)
    fault = judged(replace(log, tau_J=in_kilonewton_metres), ur10e).fault
    assert fault is not None
    assert fault.cause == "torques a thousand times too small"


@pytest.mark.parametrize("kind", list(DAMAGES))
def test_a_fault_is_named_and_its_remedy_mends_the_log(
    ur10e: Robot, tmp_path: Path, kind: str
) -> None:
    name, damage = DAMAGES[kind]
    path = tmp_path / "log.csv"
    write_recording(damage(motion(ur10e), ur10e), path)
    judgement = judged(read_recording(path, robot=ur10e), ur10e)
    assert judgement.fault is not None, judgement.log_odds
    assert judgement.fault.name == name, judgement.sentence()
    word = judgement.sentence().partition("--log-format ")[2].split()[0].strip(";,")
    mended = judged(read_recording(path, word, ur10e), ur10e)
    assert mended.fault is None, mended.sentence()


def test_units_of_angles_are_named(ur10e: Robot) -> None:
    log = motion(ur10e)
    revolutions = judged(replace(log, q=log.q / TURN, v=log.v / TURN), ur10e).sentence()
    assert "positions and velocities in revolutions, read as rad" in revolutions
    assert "set position: {unit: rev}, velocity: {unit: rev/s} in a description" in revolutions
    half = judged(replace(log, q=0.5 * log.q, v=0.5 * log.v), ur10e).fault
    assert half is not None
    assert "positions and velocities of all joints that are to be multiplied by" in half.cause
    assert half.values["factor"] == pytest.approx(2.0, rel=0.03)


@pytest.mark.parametrize(("joint", "factor"), [(2, 0.5), (2, 2.0), (3, TURN)])
def test_a_factor_of_one_joint_is_named(ur10e: Robot, joint: int, factor: float) -> None:
    """Of the elbow and a wrist: counts of another gear, or revolutions."""
    log = motion(ur10e)
    factors = np.where(np.arange(6) == joint, factor, 1.0)
    fault = judged(replace(log, q=log.q / factors, v=log.v / factors), ur10e).fault
    assert fault is not None
    assert fault.name == "unit of the positions"
    assert fault.values["joint"] == joint + 1.0
    found, sd = fault.values["factor"], fault.values["factor_sd"]
    assert isinstance(found, float)
    assert isinstance(sd, float)
    assert abs(found - factor) < 4.0 * sd < 0.6 * factor
    assert ("as revolutions are" in fault.cause) == (factor == TURN)


def test_delays_are_found_to_within_their_error(ur10e: Robot) -> None:
    """A sample of 10 ms is the coarsest that interpolation of the rows may cost."""
    for delay in (-0.5, 0.2, 2.0):
        fault = judged(later(motion(ur10e), delay), ur10e).fault
        assert fault is not None
        assert fault.values["delay_s"] == pytest.approx(delay, abs=0.01)


@pytest.mark.parametrize(
    ("joints", "delay", "are_drives"),
    [((2,), 0.2, True), ((3, 4, 5), -0.3, True), ((1,), 0.25, False)],
)
def test_late_signals_of_single_joints_are_named_and_mended(
    ur10e: Robot, tmp_path: Path, joints: tuple[int, ...], delay: float, are_drives: bool
) -> None:
    """With the joints that are late alone; rows are 50 ms apart."""
    log = motion(ur10e)

    def late(x: np.ndarray) -> np.ndarray:
        columns = [np.interp(log.t - delay * (j in joints), log.t, x[:, j]) for j in range(6)]
        return np.stack(columns, axis=1)

    if are_drives:
        log = replace(log, current=late(log.current))
    else:
        log = replace(log, q=late(log.q), v=late(log.v))
    fault = judge_log([log], ur10e, identified(ur10e)).fault
    assert fault is not None
    assert fault.name == "time of single joints"
    assert fault.values["joints"] == [j + 1.0 for j in joints]
    assert fault.values["delay_s"] == pytest.approx(delay, abs=0.02)
    # What is to be set, literally.
    write_recording(replace(log, extra={}), tmp_path / "log.csv")
    signals = {"current": "i"} if are_drives else {"position": "q", "velocity": "v"}
    description = {"header": True, "time": {"columns": "t"}}
    for key, letter in {"position": "q", "velocity": "v", "current": "i"}.items():
        description[key] = {"columns": f"{letter}{{1..6}}"}
        if key in signals:
            stated = fault.remedy.partition(f"{key}: {{joint_delay: ")[2].partition("}")[0]
            description[key]["joint_delay"] = yaml.safe_load(stated)
    (tmp_path / "log.yaml").write_text(yaml.safe_dump(description))
    mended = read_recording(tmp_path / "log.csv", tmp_path / "log.yaml", ur10e)
    assert judge_log([mended], ur10e, identified(ur10e)).fault is None


def test_where_most_drives_are_late_no_set_of_them_is_tried(ur10e: Robot) -> None:
    """All are late then, and some not surely."""
    log, late = motion(ur10e), later(motion(ur10e), 0.1)
    log = replace(log, current=np.hstack([late.current[:, :4], log.current[:, 4:]]))
    rows = judgement.log_rows([log], ur10e)
    guesses = joint_time._guesses(Case(rows, ur10e, identified(ur10e)), are_drives=True)
    assert max(len(guess.shifted.joints) for guess in guesses) <= 3


def test_an_average_is_told_from_a_delay(ur10e: Robot) -> None:
    fault = judged(averaged(motion(ur10e), 0.5), ur10e).fault
    assert fault is not None
    assert fault.values["average_s"] == pytest.approx(0.5, abs=0.3)  # the grid's next neighbours
    assert fault.values["delay_s"] == pytest.approx(0.25, abs=0.03)


@pytest.mark.parametrize(
    ("gravity", "word"),
    [((9.81, 0.0, 0.0), "wall"), ((0.0, 0.0, 9.81), "hangs"), ((3.36, 0.0, -9.22), "tilted")],
)
def test_gravitys_direction_is_named(
    ur10e: Robot, gravity: tuple[float, float, float], word: str
) -> None:
    fault = judged(motion(ur10e, np.array(gravity)), ur10e).fault
    assert fault is not None
    assert fault.name == "direction of gravity"
    assert word in fault.cause
    # Masses of a robot's file are taken as within 20 %: they share the error of 5 deg.
    np.testing.assert_allclose(fault.values["gravity_m_per_s2"], gravity, atol=0.9)


def test_a_zero_is_found_with_its_error(ur10e: Robot) -> None:
    log = motion(ur10e)
    q = log.q.copy()
    q[:, 1] += 0.5 * np.pi
    fault = judged(replace(log, q=q), ur10e).fault
    assert fault is not None
    assert fault.name == "zero of a joint"
    assert fault.values["joint"] == 2.0
    offset, sd = fault.values["q_offset"], fault.values["q_offset_sd"]
    assert isinstance(offset, float)
    assert isinstance(sd, float)
    assert abs(offset + 0.5 * np.pi) < 4.0 * sd < 0.4


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_position_that_counts_the_joint_before_is_named(ur10e: Robot, sign: float) -> None:
    """As Fanuc's pendant shows J3: relative to the ground."""
    log = motion(ur10e)
    q, v = log.q.copy(), log.v.copy()
    q[:, 2] += sign * q[:, 1]
    v[:, 2] += sign * v[:, 1]
    fault = judged(replace(log, q=q, v=v), ur10e).fault
    assert fault is not None
    assert fault.name == "angle of a link for that of its joint"
    assert fault.values == {"joint": 3.0, "sign": -sign}
    change = "subtract" if sign > 0.0 else "add"
    assert fault.remedy.startswith(f"{change} the positions of shoulder_lift_joint")


def test_the_remedy_of_a_zero_contains_what_the_file_has(ur10e: Robot) -> None:
    """The log's positions have it already, so that the file needs the sum."""
    log = motion(ur10e)
    q = log.q.copy()
    q[:, 1] += 0.5 * np.pi
    drives = list(ur10e.config.drives)
    drives[1] = replace(drives[1], q_offset=1.0)
    fault = judged(replace(log, q=q), ur10e.with_drives(drives)).fault
    assert fault is not None
    offset = fault.values["q_offset"]
    assert isinstance(offset, float)
    assert f"q_offset: {1.0 + offset:.4f} at shoulder_lift_joint" in fault.remedy


@pytest.mark.parametrize(
    ("gain", "word"),
    [
        (1000.0, "mA"),
        (1e6, "a millionth of an ampere"),
        (0.0, "N m in place of currents"),
        (-1.0, "per mille"),
    ],
)
def test_units_are_named(ur10e: Robot, gain: float, word: str) -> None:
    log = motion(ur10e)
    gains = np.full(6, gain)
    if gain == 0.0:
        gains = ur10e.torque_per_ampere
    if gain == -1.0:
        gains = ur10e.torque_per_ampere / np.array([0.33, 0.33, 0.15, 0.056, 0.056, 0.056])
    fault = judged(replace(log, current=log.current * gains), ur10e).fault
    assert fault is not None
    assert fault.name == "unit or gain of the drives"
    assert word in fault.cause


def identified(ur10e: Robot) -> IdentifiedModel:
    """The model of logs as `motion` makes them."""
    return replace(
        IdentifiedModel.nominal(ur10e),
        friction=SemiParametricFriction(CoulombViscous(COULOMB, np.zeros(6), np.zeros(6))),
        residual_covariance=0.5**2 * np.eye(6),
        provenance=Provenance(logs=[LogSource("identification.csv")]),
    )


@pytest.mark.parametrize(
    ("gain", "word"),
    [(0.5**0.5, "the log has effective values (rms)"), (2.0**0.5, "had effective values"),
     (2.0, "another torque per ampere"), (1.15, "another torque per ampere"),
     (0.87, "another torque per ampere"), (1.05, "")],
)  # fmt: skip
def test_a_common_gain_is_named_beside_a_model_of_the_same_drives(
    ur10e: Robot, gain: float, word: str
) -> None:
    """A torque constant is some per cent off; a load or a force explains no gain of all joints."""
    log = motion(ur10e)
    fault = judge_log([replace(log, current=gain * log.current)], ur10e, identified(ur10e)).fault
    assert (fault is not None) == bool(word)
    if fault is not None:
        assert fault.name == "unit or gain of the drives"
        assert word in fault.cause
        # Masses, open within 1 % of each link, take a part of a gain.
        assert np.array(fault.values["gain"]) == pytest.approx(gain, rel=0.015)
        stated = float(fault.remedy.partition("gain: [")[2].partition("]")[0])
        assert stated == pytest.approx(1.0 / gain, rel=0.02)


@pytest.mark.parametrize(("joints", "gain"), [((0, 1, 2), 1.3), ((1, 2), 0.8), ((2,), 1.25)])
def test_a_gain_of_some_joints_is_named_with_these_alone(
    ur10e: Robot, joints: tuple[int, ...], gain: float
) -> None:
    log = motion(ur10e)
    gains = np.where(np.isin(np.arange(6), joints), gain, 1.0)
    fault = judge_log([replace(log, current=gains * log.current)], ur10e, identified(ur10e)).fault
    assert fault is not None
    assert fault.name == "unit or gain of the drives"
    assert np.array(fault.values["gain"]) == pytest.approx(gains, rel=0.02)
    names = [name for name in ur10e.joint_names if name in fault.cause]
    assert names == [ur10e.joint_names[j] for j in joints]
    stated = yaml.safe_load(fault.remedy.partition("gain: ")[2].partition("}")[0])
    assert stated == pytest.approx(1.0 / gains, rel=0.02)


@pytest.mark.parametrize(
    ("sd", "damage", "name"),
    [
        (0.5, lambda log: replace(log, current=1.2 * log.current), "data of the model"),
        (0.005, lambda log: replace(log, current=1.2 * log.current), "unit or gain of the drives"),
        (
            0.5,
            lambda log: replace(log, current=log.current[:, [1, 0, 2, 3, 4, 5]]),
            "order of the drives",
        ),
    ],
)
def test_a_model_of_too_little_motion_is_named_in_the_place_of_a_gain(
    ur10e: Robot, sd: float, damage: Callable[[Recording], Recording], name: str
) -> None:
    """Where its own parameters leave as much open; a wrong order explains far more than that."""
    names = [f"{parameter}[{joint}]" for joint in ur10e.joint_names[1:4] for parameter in MOMENTS]
    model = replace(
        identified(ur10e),
        base_parameters=BaseParameterTable(names, [0.0] * 9, [sd] * 9),
        provenance=Provenance(logs=[LogSource("identification.csv", duration=5.0)]),
    )
    judgement = judge_log([damage(motion(ur10e))], ur10e, model)
    assert judgement is not None
    assert judgement.fault is not None
    assert judgement.fault.name == name
    said = "a model that was identified from 5 s of motion" in judgement.sentence()
    assert said == (name == "data of the model")
    assert judgement.metrics()["log10_odds"][name] > 2.0


@pytest.mark.parametrize("gain", [1e3, 1e-3, 30.0])
def test_another_unit_is_named_beside_a_model_of_the_same_drives(ur10e: Robot, gain: float) -> None:
    """The fit of a gain near 1, which there is none of, ends within its range."""
    log = motion(ur10e)
    fault = judge_log([replace(log, current=gain * log.current)], ur10e, identified(ur10e)).fault
    assert fault is not None
    assert fault.name == "unit or gain of the drives"
    assert np.array(fault.values["gain"]) == pytest.approx(gain, rel=0.2)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", ["ur-20_01_22-joint_2", "ur-20_02_19_14harm50secLoad"])
def test_currents_a_thousand_times_too_large_leave_all_odds_finite(
    ur10e: Robot, data: Callable[[str], Path], name: str
) -> None:
    """No hypothesis goes so far from the log that its torques overflow."""
    log = resampled(read_recording(data(f"ur10e/{name}.csv"), robot=ur10e))
    judgement = judge_log([replace(log, current=1e3 * log.current)], ur10e, identified(ur10e))
    assert judgement is not None
    assert judgement.fault is not None
    assert judgement.fault.name == "unit or gain of the drives"
    assert all(math.isfinite(odds) for odds in judgement.log_odds.values())


def test_a_load_is_no_gain(ur10e: Robot) -> None:
    """It loads all joints, as a gain of the torques that hold the arm does."""
    log = motion(ur10e, force=np.array([0.0, 0.0, -9.81 * 0.5 * ur10e.payload]))
    assert judge_log([log], ur10e, identified(ur10e)).fault is None


def test_a_mean_about_each_sample_is_named_beside_a_model(ur10e: Robot) -> None:
    """It is not late. Friction that turns round slowly looks alike, but the model has fitted it."""
    log, window = motion(ur10e), 0.5
    size = round(window / STEP)
    current = uniform_filter1d(log.current, size, axis=0, mode="nearest")
    fault = judge_log([replace(log, current=current)], ur10e, identified(ur10e)).fault
    assert fault is not None
    assert fault.values["average_s"] == pytest.approx(window, abs=0.11)  # the grid's neighbours
    assert fault.values["delay_s"] == pytest.approx(0.0, abs=0.01)
    assert "about each sample" in fault.cause
    assert "delay" not in fault.remedy


def test_a_coupled_wrist_that_is_not_stated_is_a_remedy_of_a_gain(
    data: Callable[[str], Path], tmp_path: Path
) -> None:
    """Of a Staubli TX40, whose motor 6 turns along with joint 5; its recording is undamaged."""
    source = data("staubli_tx40/excitation.csv").parent
    layout = yaml.safe_load((source / "recording.yaml").read_text(encoding="utf-8"))
    layout["motor_torque"] = {"columns": layout.pop("current")["columns"], "unit": "N m"}
    (tmp_path / "log.yaml").write_text(yaml.safe_dump(layout), encoding="utf-8")
    config = yaml.safe_load((source / "robot.yaml").read_text(encoding="utf-8"))
    config["urdf"] = str(source / "robot.urdf")
    coupling = np.eye(6)
    coupling[5, 4] = -1.0
    judgements = []
    for change in ({}, {"coupling": coupling.tolist()}):
        (tmp_path / "robot.yaml").write_text(yaml.safe_dump(config | change), encoding="utf-8")
        robot = Robot.load(tmp_path / "robot.yaml")
        log = read_recording(source / "excitation.csv", tmp_path / "log.yaml", robot)
        found = judge_log([resampled(log)], robot, None)
        assert found is not None
        judgements.append(found)
    as_it_is, with_coupling = judgements
    assert "if the motor of joint_6 turns along with joint_5" in as_it_is.remedy()
    assert with_coupling.fault is None


def test_a_current_without_sign_is_named(ur10e: Robot) -> None:
    log = motion(ur10e)
    fault = judged(replace(log, current=np.abs(log.current)), ur10e).fault
    assert fault is not None
    assert fault.name == "current without sign"


def test_a_drive_that_stands_still_is_named(ur10e: Robot) -> None:
    """Its joint moves; the others' currents contradict no sign, zero or unit of theirs."""
    log = motion(ur10e)
    current = log.current.copy()
    current[:, 2] = current[0, 2]
    fault = judged(replace(log, current=current), ur10e).fault
    assert fault is not None
    assert fault.name == "drive that stands still"
    assert f"of elbow_joint (at {current[0, 2]:.3g} A)" in fault.cause
    assert fault.values["joints"] == [3.0]
    # It may carry one torque while it rests.
    q, v = log.q.copy(), log.v.copy()
    q[:, 2], v[:, 2] = q[0, 2], 0.0
    at_rest = judge_log([replace(log, q=q, v=v, current=current)], ur10e, None)
    assert at_rest is not None
    assert "drive that stands still" not in at_rest.log_odds


@pytest.mark.parametrize("joints", [(0,), (0, 3)])
def test_a_current_without_sign_at_some_joints_is_named(
    ur10e: Robot, joints: tuple[int, ...]
) -> None:
    log = motion(ur10e)
    is_unsigned = np.isin(np.arange(6), joints)
    current = np.where(is_unsigned, np.abs(log.current), log.current)
    fault = judged(replace(log, current=current), ur10e).fault
    assert fault is not None
    assert fault.name == "current without sign"
    assert fault.values["joints"] == [j + 1.0 for j in joints]
    assert f"at {', '.join(ur10e.joint_names[j] for j in joints)} (no value is" in fault.cause


LIMIT = np.array([99.0, 99.0, 4.0, 99.0, 99.0, 99.0])  # A


def between_slow_samples(log: Recording, rows: int) -> Recording:
    """Positions and velocities straight between each `rows`th sample."""
    at = log.t[::rows]
    q, v = (
        np.stack([np.interp(log.t, at, x) for x in signal[::rows].T], axis=1)
        for signal in (log.q, log.v)
    )
    return replace(log, q=q, v=v)


@pytest.mark.parametrize(
    ("name", "words", "damage"),
    [
        (
            "drives cut off",
            "elbow_joint (-4 A for",
            lambda log: replace(log, current=np.clip(log.current, -LIMIT, LIMIT)),
        ),
        (
            "steps of the drives",
            "in steps of 1 A",
            lambda log: replace(log, current=np.round(log.current)),
        ),
        (
            "positions between slow samples",
            "samples 0.5 s apart (2 a second)",
            lambda log: between_slow_samples(log, 25),
        ),
    ],
)
def test_what_a_logger_did_to_samples_is_named(
    ur10e: Robot, name: str, words: str, damage: Callable[[Recording], Recording]
) -> None:
    fault = judge_log([damage(motion(ur10e))], ur10e, identified(ur10e)).fault
    assert fault is not None
    assert fault.name == name
    assert words in fault.cause


@pytest.mark.parametrize("force", [(0.0, 0.0, 0.0), (0.0, 0.0, 150.0), (60.0, -90.0, 0.0)])
def test_a_force_at_the_tool_is_no_fault(ur10e: Robot, force: tuple[float, float, float]) -> None:
    judgement = judged(motion(ur10e, force=np.array(force)), ur10e)
    assert judgement.fault is None, judgement.sentence()


def test_a_lasting_force_stands_for_itself(ur10e: Robot) -> None:
    """A force for half of the log, beside a small model error: the evidence alone prefers it to a
    tilt, a zero or a gain, which have fewer numbers than a force for each row."""
    force = np.array([20.0, -12.0, 18.0])
    log, pushed = motion(ur10e), motion(ur10e, force=force)
    touches = (log.t > 6.0) & (log.t < 18.0)
    current = np.where(touches[:, None], pushed.current, log.current)
    judgement = judge_log([replace(log, current=current)], ur10e, identified(ur10e))
    assert judgement is not None
    others = {key: odds for key, odds in judgement.log_odds.items() if key != "force that lasts"}
    assert judgement.log_odds["force that lasts"] > math.log(1e6)
    assert max(others.values()) < 0.0, others


def test_a_force_beyond_the_payload_that_lasts_is_said_as_a_force(ur10e: Robot) -> None:
    log, pushed = motion(ur10e), motion(ur10e, force=np.array([0.0, 400.0, 300.0]))
    current = np.where((log.t > 3.0)[:, None], pushed.current, log.current)
    judgement = judge_log([replace(log, current=current)], ur10e, identified(ur10e))
    assert judgement is not None
    assert judgement.fault is None, judgement.sentence()
    assert judgement.kind_share["pressed"] > 0.5
    assert judgement.sentence().startswith("a force at the tool beyond what the arm is made for")
    of_each_row = replace(judgement, log_odds={})  # no force that lasts
    assert "none of these explains" in of_each_row.sentence()


def slide(robot: Robot) -> Recording:
    """The tool presses with 60 N on what it slides along, for 20 of 24 s."""
    log = motion(robot)
    velocity = np.einsum("tij,tj->ti", robot.chain.jacobian(log.q)[:, 3:], log.v)
    friction = -0.3 * 60.0 * velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    touches = (log.t > 2.0) & (log.t < 22.0)
    force = touches[:, None] * (np.array([0.0, 0.0, 60.0]) + friction)
    return motion(robot, force=force)


def test_a_slide_is_a_force_that_lasts(ur10e: Robot) -> None:
    """A constant force and one along the motion of the tool explain it."""
    rows = judgement.log_rows([slide(ur10e)], ur10e)
    assert rows is not None
    case = Case(rows, ur10e, identified(ur10e))
    force = lasting_force.explain(case)
    assert force is not None
    # Noise and the edges of the contact leave 0.06 % of the torque's mean square; beside a constant
    # force alone, friction leaves 18 %.
    assert 1.0 - force.explained < 0.01
    assert judgement.judge(case).fault is None


@pytest.mark.parametrize(
    ("damage", "name", "values"),
    [
        (
            lambda log: replace(log, current=log.current[:, [0, 1, 2, 4, 3, 5]]),
            "order of the drives",
            {"order": [1.0, 2.0, 3.0, 5.0, 4.0, 6.0]},
        ),
        (
            lambda log: replace(log, current=turned(log.current, 3)),
            "signs of the drives",
            {"sign": [1.0, 1.0, 1.0, -1.0, 1.0, 1.0]},
        ),
        (
            lambda log: replace(log, q=turned(log.q, 2), v=turned(log.v, 2)),
            "signs of the joints",
            {"sign": [1.0, 1.0, -1.0, 1.0, 1.0, 1.0]},
        ),
    ],
)
def test_orders_and_signs_are_named_beside_a_contact_for_most_of_the_log(
    ur10e: Robot, damage: Callable[[Recording], Recording], name: str, values: dict[str, float]
) -> None:
    fault = judge_log([damage(slide(ur10e))], ur10e, identified(ur10e)).fault
    assert fault is not None
    assert fault.name == name
    assert fault.values == values
    assert fault.has_force


def test_a_fault_beside_a_contact_explains_more_than_drift_may_leave(
    ur10e: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sign of a wrist explained 2 % more of a log with drifted friction and steps of force."""
    log = slide(ur10e)
    log = replace(log, current=turned(log.current, 3))
    monkeypatch.setattr(judgement, "MIN_EXPLAINED_BESIDE_FORCE", 1.0)
    fault = judge_log([log], ur10e, identified(ur10e)).fault
    assert fault is None or not fault.has_force


def test_a_log_that_nothing_explains_is_said_as_that(ur10e: Robot) -> None:
    """Currents of another motion."""
    log = motion(ur10e)
    rng = np.random.default_rng(2)
    angle = log.t[:, None] * rng.uniform(0.5, 3.0, 6) + np.arange(6)
    current = 0.8 * np.sin(angle) * ur10e.current_limit
    judgement = judged(replace(log, current=current), ur10e)
    assert judgement.fault is not None or "none of these explains" in judgement.sentence()


@pytest.mark.parametrize(
    "name",
    ["ur-20_01_17-ptp_10_points", "ur-20_02_19_14harm50secLoad", "ur-20_01_22-joint_2"],
)
def test_real_logs_are_not_wrong(ur10e: Robot, data: Callable[[str], Path], name: str) -> None:
    judgement = judged(read_recording(data(f"ur10e/{name}.csv"), robot=ur10e), ur10e)
    assert judgement.fault is None, judgement.sentence()


def fault(kind_share, has_form=True):
    empty = np.empty(0)
    fit = Fit(0.0, theta=empty, sd=empty, kind_share=np.array(kind_share), residual=empty)
    fitted = FittedView(None, fit, explained=0.99)  # the rules read no view
    return Explanation("a fault", fitted, 0.0, "it", "mend it", has_form=has_form)


def explanation(name, case, gain, explained, kind_share, **kinds):
    """Of a case, whose evidence as it is has grown by `gain`."""
    fit = replace(case.base_fit, kind_share=np.array(kind_share))
    fitted = FittedView(case.base, fit, explained)
    return Explanation(name, fitted, gain, "it", "mend it", may_hide_force=False, **kinds)


def test_what_is_to_be_tried_holds_the_words_in_use() -> None:
    remedy = "turn it, or try --log-format drives-turned=2"
    turned_drives = replace(fault((1.0, 0.0, 0.0, 0.0, 0.0)), remedy=remedy)
    judgement = Judgement("current", 0.5, {}, {turned_drives.name: 50.0}, turned_drives, rival=None)
    sentence = judgement.sentence("drives-order=2-1-3-4-5-6")
    assert "try --log-format drives-order=2-1-3-4-5-6,drives-turned=2;" in sentence
    assert "try --log-format drives-turned=2;" in judgement.sentence()


@pytest.mark.parametrize(
    ("base", "left", "stands"),
    [
        # free, poor, touched, pressed, odd; the first three are good logs of a simulator of others
        ((0.21, 0.0, 0.79, 0.0, 0.0), (0.32, 0.45, 0.22, 0.0, 0.0), False),  # a force that lasts
        ((0.25, 0.28, 0.48, 0.0, 0.0), (0.80, 0.06, 0.14, 0.0, 0.0), False),  # beside free motion
        ((0.55, 0.35, 0.10, 0.0, 0.0), (0.58, 0.42, 0.0, 0.0, 0.0), False),  # a poor model
        ((0.37, 0.62, 0.01, 0.0, 0.0), (0.99, 0.01, 0.0, 0.0, 0.0), True),  # nothing is left
        ((0.00, 0.04, 0.19, 0.0, 0.77), (0.34, 0.19, 0.47, 0.0, 0.0), True),  # no force does that
        ((0.02, 0.03, 0.95, 0.0, 0.0), (0.60, 0.20, 0.20, 0.0, 0.0), True),  # contact all the time
    ],
)
def test_a_force_that_lasts_is_no_fault(base, left, stands):
    assert stands_beside_contact(fault(left), np.array(base), 0.97) == stands
    # Gravity missing has nothing to fit: it stands where the log as it is explains little.
    assert stands_beside_contact(fault(left, has_form=False), np.array(base), 0.7)


@pytest.mark.parametrize(
    ("explained", "odd", "has_form", "is_named"),
    [
        (0.4, 0.2, True, False),
        (0.6, 0.2, True, True),
        (0.4, 0.0, True, True),  # contact is all that is left: a heavy push, all the time
        (0.4, 0.2, False, True),  # external torque, of which a log may hold nearly none
    ],
)
def test_a_choice_that_leaves_more_than_it_explains_is_no_cause(
    ur10e, monkeypatch, explained, odd, has_form, is_named
):
    """Of many orders one always fits best, also where the model fits nothing of the log."""

    def explain(case: Case) -> Explanation:
        share = (0.2, 0.3, 0.5 - odd, 0.0, odd)
        return explanation("order", case, 60.0, explained, share, has_form=has_form)

    monkeypatch.setattr(judgement, "HYPOTHESES", {"order": explain})
    log = motion(ur10e)
    current = 0.8 * np.sin(3.0 * log.t[:, None] + np.arange(6)) * ur10e.current_limit
    result = judged(replace(log, current=current), ur10e)
    assert result.explained < 0.1
    assert (result.fault is not None) == is_named, result.sentence()


@pytest.mark.parametrize(("delay", "stands"), [(0.0, False), (0.3, True)])
def test_a_small_fault_is_none_where_the_log_fits_as_it_is(ur10e, monkeypatch, delay, stands):
    """A tenth of what a log that fits leaves unexplained is the model's own error, at any odds; of
    a log that does not fit it may be a zero."""

    def explain(case: Case) -> Explanation:
        explained = 1.0 - 0.9 * (1.0 - case.base_fitted.explained)
        share = (0.99, 0.01, 0.0, 0.0, 0.0)
        return explanation("zero", case, 50.0, explained, share, is_small=True)

    monkeypatch.setattr(judgement, "HYPOTHESES", {"zero": explain})
    log = later(motion(ur10e), delay)
    exact = replace(IdentifiedModel.nominal(ur10e), residual_covariance=0.5**2 * np.eye(6))
    assert (judge_log([log], ur10e, exact).fault is not None) == stands


@pytest.mark.parametrize(
    ("left", "rival", "logs", "stands"),
    [
        (0.8, 0.0, 1, True),
        (0.9, 0.0, 1, False),  # the model's own error
        (0.8, 60.0, 1, False),  # another fault is likelier, if it explains too little to be named
        (0.8, 0.0, 0, False),  # a robot's file: its masses show as a zero
    ],
)
def test_a_small_fault_is_named_where_the_log_fits_as_it_is(
    ur10e, monkeypatch, left, rival, logs, stands
):
    """A fifth of what an identified model leaves unexplained, as a zero that is off by .05 rad
    leaves on recordings of a UR10e."""

    def explained_as(case: Case, name: str, gain: float, is_small: bool) -> Explanation:
        explained = 1.0 - left * (1.0 - case.base_fitted.explained)
        share = (0.99, 0.01, 0.0, 0.0, 0.0)
        return explanation(name, case, gain, explained, share, is_small=is_small)

    hypotheses = {
        "zero": lambda case: explained_as(case, "zero", 50.0, True),
        "tilt": lambda case: explained_as(case, "tilt", rival, False),
    }
    monkeypatch.setattr(judgement, "HYPOTHESES", hypotheses)
    model = replace(
        IdentifiedModel.nominal(ur10e),
        friction=SemiParametricFriction(CoulombViscous(COULOMB, np.zeros(6), np.zeros(6))),
        residual_covariance=0.5**2 * np.eye(6),
        provenance=Provenance(logs=[LogSource("identification.csv")] * logs),
    )
    log = motion(ur10e)
    case = Case(judgement.log_rows([log], ur10e), ur10e, model)
    assert case.base_is_good
    fault = judge_log([log], ur10e, model).fault
    assert (fault is not None) == stands
    assert fault is None or fault.name == "zero"
