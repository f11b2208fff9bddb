"""Tables whose columns are named by words, each of the same motion, against that motion."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording_reader import read_recording

_ROWS, _JOINTS = 40, ("shoulder_pan_joint", "elbow_joint", "wrist_1_joint")
_ROBOT = SimpleNamespace(
    name="arm",
    num_joints=3,
    joint_names=_JOINTS,
    q_offset=np.zeros(3),
    velocity_limit=np.full(3, np.inf),
    position_lower=np.full(3, -np.inf),
    position_upper=np.full(3, np.inf),
    motor_current=lambda tau_J: tau_J,
    chain=SimpleNamespace(prismatic=np.zeros(3, bool)),
)
_T = 0.01 * np.arange(_ROWS)
_Q = np.round(np.sin(_T[:, None] + np.arange(3)), 6)
_V = np.round(np.cos(_T[:, None] + np.arange(3)), 6)
_I = np.round(1.0 + _Q**2, 6)


def _csv(
    tmp_path: Path, header: list[str], columns: list[np.ndarray], separator: str = ","
) -> Path:
    path = tmp_path / "log.csv"
    rows = [separator.join(str(x) for x in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([separator.join(header), *rows]) + "\n")
    return path


def _joints(text: str, number: int = 1) -> list[str]:
    """A name for each joint; {j} is its number, {n} its name."""
    return [text.format(j=k + number, n=name) for k, name in enumerate(_JOINTS)]


@pytest.mark.parametrize(
    ("time", "q", "v", "i", "scale"),
    [
        ("t", "q{j}_deg", "v{j}", "i{j}", (180 / np.pi, 1.0, 1.0)),
        ("Time [s]", "J{j} Position [deg]", "J{j} Speed [deg/s]", "J{j} Current [mA]",
         (180 / np.pi, 180 / np.pi, 1e3)),
        ("robot_time", "left_{n}_pos", "left_{n}_vel", "left_{n}_current", (1.0, 1.0, 1.0)),
        ("Zeit", "AxisAct_A{j}_Angle(deg)", "AxisAct_A{j}_Speed", "AxisAct_A{j}_Current",
         (180 / np.pi, 1.0, 1.0)),
        # A joint's actual value without a quantity is its position, where nothing else is.
        ("Zeit [s]", "Achse{j}_Ist", "Achse{j}_Istgeschwindigkeit", "Achse{j}_Motorstrom",
         (1.0, 1.0, 1.0)),
        ("cycle_ms", "Axis {j}.Position (rev)", "Axis {j}.Speed (1/min)", "Axis {j}.Current (A)",
         (0.5 / np.pi, 30 / np.pi, 1.0)),
        ("Zeitstempel", "Winkel Achse {j} [Grad]", "Drehzahl Achse {j} [1/min]",
         "Strom Achse {j} [A]", (180 / np.pi, 30 / np.pi, 1.0)),
        ("t", "axis{j}.encoder.pos_estimate", "axis{j}.encoder.vel_estimate",  # ODrive, in turns
         "axis{j}.motor.current_control.Iq_measured", (0.5 / np.pi, 0.5 / np.pi, 1.0)),
        ("IPOC", "AIPos.A{j}", "$VEL_AXIS_ACT[{j}]", "MACur.A{j}", (1.0, 1.0, 1.0)),
        ("Zeitstempel", "Istposition [Grad] A{j}", "Istgeschw. [Grad/s] A{j}", "Iststrom [A] A{j}",
         (180 / np.pi, 180 / np.pi, 1.0)),
        ("tiempo", "eje {j} posición", "eje {j} velocidad", "eje {j} corriente", (1.0, 1.0, 1.0)),
        ("time", "rax_{j}", "speed rax_{j}", "current rax_{j}", (1.0, 1.0, 1.0)),
        ("时间(ms)", "关节{j}位置(°)", "关节{j}速度(°/s)", "关节{j}电流(mA)",
         (180 / np.pi, 180 / np.pi, 1e3)),
        ("t", "jointpos{j}", "jointvel{j}", "motorcurrent{j}", (1.0, 1.0, 1.0)),
        ("DATETIME[YYYY/MM/DD hh:mm:ss] TIME(UTC+09:00)", "J{j} FB POS 0.0001deg",
         "J{j} FB SPD [0.1 deg/s]", "J{j} CUR mA", (1e4 * 180 / np.pi, 10 * 180 / np.pi, 1e3)),
        ("log.stamp", "state.positions_deg.{j}", "state.velocities_deg_s.{j}", "state.currents.{j}",
         (180 / np.pi, 180 / np.pi, 1.0)),
        ("stamp", "joint_angles_{j}", "joint_vels_{j}", "joint_amps_{j}", (1.0, 1.0, 1.0)),
        ("stamp", "actual_position_{j}", "actual_velocity_{j}", "actual_current_{j}",
         (1.0, 1.0, 1.0)),
        # A position is what the other names have without their quantity.
        ("pc_ts", "ur3_arm_joint_{j}", "ur3_arm_joint_vel_{j}", "ur3_arm_joint_current_{j}",
         (1.0, 1.0, 1.0)),
    ],
)  # fmt: skip
def test_words_and_units_are_recognised(
    tmp_path: Path, time: str, q: str, v: str, i: str, scale: tuple[float, float, float]
) -> None:
    extra = [
        "robot mode",
        "arm_runtime_state",
        *_joints("target_" + q),
        *_joints("action_" + q),
        *_joints("temperature_{j}"),
    ]
    header = [time, *_joints(q), *_joints(v), *_joints(i), *extra]
    signals = np.hstack([_Q * scale[0], _V * scale[1], _I * scale[2]])
    t = 1e3 * _T if time in ("IPOC", "cycle_ms", "时间(ms)") else _T  # KUKA's clock is in ms
    columns = [t, *signals.T, *np.full((len(extra), _ROWS), 7.0)]
    log = read_recording(_csv(tmp_path, header, columns), None, _ROBOT, check=False)
    for read, expected in ((log.q, _Q), (log.v, _V), (log.current, _I)):
        np.testing.assert_allclose(read, expected, atol=1e-12)  # rounding of the unit
    assert any("read by the words in their names" in text for text in log.notices)
    assert any("left out: robot mode" in text for text in log.notices)


def test_joints_may_have_a_number_and_a_letter(tmp_path: Path) -> None:
    joints = [f"joint_{k + 1}_{letter}" for k, letter in enumerate("slu")]
    header = ["t"] + [f"{joint}_{x}" for x in ("position", "torque") for joint in joints]
    log = read_recording(_csv(tmp_path, header, [_T, *_Q.T, *_I.T]), None, _ROBOT, check=False)
    np.testing.assert_array_equal(log.q, _Q)
    assert log.tau_J is not None
    np.testing.assert_array_equal(log.tau_J, _I)


@pytest.mark.parametrize(
    "times", [("ZeitInSec", "ZeitInNanoSec"), ("secs", "nsecs"), ("TimeSec", "TimeNanosec")]
)
def test_seconds_and_nanoseconds_are_one_time(tmp_path: Path, times: tuple[str, str]) -> None:
    header = [*times, *_joints("q{j}"), *_joints("v{j}"), *_joints("i{j}")]
    seconds = 1_357_683_843 + np.floor(10 * _T).astype(int)  # of a clock ten times as fast
    nanoseconds = np.round(1e9 * (10 * _T % 1.0)).astype(int)
    columns = [seconds, nanoseconds, *_Q.T, *_V.T, *_I.T]
    log = read_recording(_csv(tmp_path, header, columns), None, _ROBOT, check=False)
    np.testing.assert_allclose(log.t - log.t[0], 10 * _T, atol=1e-6)  # of doubles at 1e9


def test_a_state_is_never_offered_as_time(tmp_path: Path) -> None:
    header = ["runtime_state", *_joints("q_{j}"), *_joints("current_{j}")]
    path = _csv(tmp_path, header, [2.0 + 0 * _T, *_Q.T, *_I.T])
    with pytest.raises(InputError, match="has no column of time"):
        read_recording(path, None, _ROBOT)


def test_joints_are_put_in_the_robots_order_by_their_names(tmp_path: Path) -> None:
    order = [1, 2, 0]
    header = ["t"] + [f"{_JOINTS[k]}_{x}" for x in ("pos", "vel", "current") for k in order]
    columns = [_T, *_Q[:, order].T, *_V[:, order].T, *_I[:, order].T]
    log = read_recording(_csv(tmp_path, header, columns), None, _ROBOT, check=False)
    np.testing.assert_array_equal(log.q, _Q)
    np.testing.assert_array_equal(log.current, _I)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        # Two series of currents, and only the owner knows which one counts.
        (["pos_{j}", "u_current_{j}", "w_current_{j}"],
         r"names 2 series of currents \(u_current_1 .., w_current_1 ..\), but not which counts"),
        (["{x}_pos", "current_{j}"], "names 3 positions, but neither by the robot's joints"),
        (["motor_{j}_pos", "joint_{j}_pos", "motor_{j}_cur", "joint_{j}_cur"],
         "in 2 ways: \"joint_\", \"motor_\"; choose one with --log-format joint-prefix=joint_"),
        (["left_{n}_pos", "right_{n}_pos", "left_{n}_current"], "joint-prefix=left_"),
    ],
)  # fmt: skip
def test_what_leaves_doubt_is_refused(tmp_path: Path, names: list[str], words: str) -> None:
    header = ["t"]
    for text in names:
        header += [text.format(x=x) for x in "xyz"] if "{x}" in text else _joints(text)
    columns = [_T] + [_Q[:, 0]] * (len(header) - 1)
    path = _csv(tmp_path, header, columns)
    with pytest.raises(InputError, match=words):
        read_recording(path, None, _ROBOT)


@pytest.mark.parametrize("names", ["J{j}", "joint{j}_angle_deg"])
def test_positions_alone_are_told(tmp_path: Path, names: str) -> None:
    path = _csv(tmp_path, ["timestamp", "cmdnum", *_joints(names)], [_T, 4.0 + 0 * _T, *_Q.T])
    with pytest.raises(InputError) as caught:
        read_recording(path, None, _ROBOT, check=False)
    first, *_, last = _joints(names)
    words = f"holds joint positions ({first} .. {last}), but no motor current or joint torque"
    assert words in str(caught.value)
    assert "record the motors' currents or torques beside them" in str(caught.value)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("positions.{j}", "numbers 4 positions"),
        ("m{j}_pos", "numbers 4 positions"),
    ],
)
def test_another_number_of_joints_is_told(tmp_path: Path, names: str, words: str) -> None:
    header = ["time", *(names.format(j=j + 1) for j in range(4)), *_joints("current_{j}")]
    path = _csv(tmp_path, header, [_T, *_Q.T, _Q[:, 0], *_I.T])
    remedy = "but the robot has 3 joints; if one is a gripper's, leave it out; else give the robot"
    with pytest.raises(InputError, match=f"{words}.*{remedy}"):
        read_recording(path, None, _ROBOT)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["target_q_{j}", "target_qd_{j}"], "names commanded values only"),
        (["shoulder.pos", "elbow.pos", "current_{j}"], "names 2 positions.*the robot has 3 joints"),
        (["pos_{j}", "current_1", "current_2"],
         r"numbers 2 currents \(current_1, current_2\), but the robot has 3 joints; record those"),
        (["shoulder.pos", "x.pos", "load_{j}"],
         r"\(shoulder.pos .. x.pos\), but no motor current or joint torque; load_1, load_2 .. is"),
    ],
)  # fmt: skip
def test_what_a_log_lacks_is_told(tmp_path: Path, names: list[str], words: str) -> None:
    header = ["time"] + [x for name in names for x in (_joints(name) if "{" in name else [name])]
    path = _csv(tmp_path, header, [_T] + [_Q[:, 0]] * (len(header) - 1))
    with pytest.raises(InputError, match=words):
        read_recording(path, None, _ROBOT)


def test_letters_of_faults_are_no_amperes(tmp_path: Path) -> None:
    header = ["time", *_joints("joint{j}.position"), *_joints("joint{j}.current")]
    header += _joints("joint{j}.fault_bank_a")
    columns = [_T, *_Q.T, *_I.T, *(0.0 * _I).T]
    log = read_recording(_csv(tmp_path, header, columns), None, _ROBOT, check=False)
    np.testing.assert_array_equal(log.current, _I)


def test_a_value_is_no_position_of_a_joint(tmp_path: Path) -> None:
    path = _csv(tmp_path, ["time", "value"], [_T, _Q[:, 0]])
    with pytest.raises(InputError, match="names no joint positions in a way that is known: value"):
        read_recording(path, None, _ROBOT)


def test_what_no_rate_mends_is_told_before_the_lack_of_a_time(tmp_path: Path) -> None:
    header = [*_joints("pos_{j}"), "current_1", "current_2"]
    path = _csv(tmp_path, header, [*_Q.T, *_I.T[:2]])
    with pytest.raises(InputError, match="numbers 2 currents"):
        read_recording(path, None, _ROBOT)
    path = _csv(tmp_path, [*_joints("pos_{j}"), *_joints("current_{j}")], [*_Q.T, *_I.T])
    with pytest.raises(InputError, match="has no column of time"):
        read_recording(path, None, _ROBOT)


def test_a_name_in_brackets_behind_a_channel_counts(tmp_path: Path) -> None:
    """As recorders write their probes with what they record, and databases their functions."""
    names = [
        name for text in ("A{j}_ActPos", "A{j}_ActVel", "A{j}_ActCur") for name in _joints(text)
    ]
    header = ["time", *(f"RECPROBE{k}({name})" for k, name in enumerate(names, start=1))]
    columns = [_T, *_Q.T, *_V.T, *_I.T]
    log = read_recording(_csv(tmp_path, header, columns), None, _ROBOT, check=False)
    np.testing.assert_array_equal(np.c_[log.q, log.v, log.current], np.c_[_Q, _V, _I])


def test_a_measured_series_counts_beside_another_one(tmp_path: Path) -> None:
    header = ["time", *_joints("q_{j}"), *_joints("q_actual_{j}"), *_joints("motor_speed_{j}")]
    header += [*_joints("joint_speed_{j}"), *_joints("i_actual_{j}"), "speed_scaling"]
    columns = [_T, *(_Q + 1.0).T, *_Q.T, *(100.0 * _V).T, *_V.T, *_I.T, 0.0 * _T]
    log = read_recording(_csv(tmp_path, header, columns), None, _ROBOT, check=False)
    np.testing.assert_array_equal(log.q, _Q)
    np.testing.assert_array_equal(log.v, _V)
    assert any("columns left out: q_1, q_2, q_3" in notice for notice in log.notices)
    assert "q_actual_1 .. is read, not q_1 .." in log.notices
    assert "joint_speed_1 .. is read, not motor_speed_1 .." in log.notices


@pytest.mark.parametrize("unit", ["A", "mA"])
def test_an_effort_in_amperes_by_its_name_is_a_current(tmp_path: Path, unit: str) -> None:
    header = ["time", *_joints("js.position[{j}]", 0), *_joints("js.effort[{j}] (" + unit + ")", 0)]
    factor = {"A": 1.0, "mA": 1e3}[unit]
    log = read_recording(_csv(tmp_path, header, [_T, *_Q.T, *(factor * _I).T]), None, _ROBOT,
                         check=False)  # fmt: skip
    np.testing.assert_allclose(log.current, _I, atol=1e-12)
    assert log.tau_J is None


def test_other_columns_beside_a_plain_header_are_left_out(tmp_path: Path) -> None:
    header = ["t", *_joints("q{j}"), *_joints("v{j}"), *_joints("i{j}"), "operator", "phase"]
    words = [np.array(["anna b"] * _ROWS), np.array(["free"] * _ROWS)]
    path = _csv(tmp_path, header, [_T, *_Q.T, *_V.T, *_I.T, *words])
    log = read_recording(path, None, _ROBOT, check=False)
    np.testing.assert_array_equal(log.current, _I)
    assert "columns left out: operator, phase" in log.notices


def test_units_in_a_line_below_the_header(tmp_path: Path) -> None:
    header = ["t", *_joints("q{j}"), *_joints("v{j}"), *_joints("i{j}")]
    path = _csv(tmp_path, header, [_T, *np.degrees(_Q).T, *np.degrees(_V).T, *_I.T])
    units = ",".join(["s", *["deg"] * 3, *["deg/s"] * 3, *["A"] * 3])
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], units, *lines[1:]]) + "\n")
    log = read_recording(path, None, _ROBOT, check=False)
    np.testing.assert_allclose(log.q, _Q, atol=1e-12)
    assert log.row is not None
    assert log.row[0] == 3  # lines as a person counts them


def test_a_torque_in_per_cent_does_not_take_the_place_of_currents(tmp_path: Path) -> None:
    header = ["t", *_joints("Position A{j} [rad]"), *_joints("Current A{j} [A]")]
    header += _joints("Torque A{j} [%]")
    path = _csv(tmp_path, header, [_T, *_Q.T, *_I.T, *(50.0 * _I).T])
    recording = read_recording(path, check=False)
    np.testing.assert_array_equal(recording.current, _I)
    assert any("left out: Torque A1 [%]" in notice for notice in recording.notices)


def test_columns_of_a_free_base_are_left_out(tmp_path: Path) -> None:
    """As MuJoCo logs a robot on one: 7 positions, 6 velocities and torques before the joints'."""
    base = [np.full(_ROWS, 0.5)] * 7
    header = ["time", *(f"qpos_{k}" for k in range(10)), *(f"qvel_{k}" for k in range(9))]
    header += [
        *(f"actuator_force_{k}" for k in range(3)),
        *(f"qfrc_actuator_{k}" for k in range(9)),
    ]
    columns = [_T, *base, *_Q.T, *base[:6], *_V.T, *(0.01 * _I.T), *base[:6], *_I.T]
    log = read_recording(_csv(tmp_path, header, columns), None, _ROBOT, check=False)
    np.testing.assert_array_equal(log.q, _Q)
    np.testing.assert_array_equal(log.v, _V)
    assert log.tau_J is not None
    np.testing.assert_array_equal(log.tau_J, _I)
    assert any("those of a free base" in notice for notice in log.notices)


def test_what_is_within_a_status_is_a_signal(tmp_path: Path) -> None:
    names = [f"joint_status.joint_{word}.{{j}}" for word in ("position", "speed", "current")]
    header = ["t", *(x for name in names for x in _joints(name))]
    log = read_recording(_csv(tmp_path, header, [_T, *_Q.T, *_V.T, *_I.T]))
    np.testing.assert_array_equal(np.c_[log.q, log.v, log.current], np.c_[_Q, _V, _I])


@pytest.mark.parametrize(
    ("plain", "raw"),
    [
        ("q_{j}", "q_raw_measured_{j}"),
        ("left_{n}_pos", "raw_left_{n}_pos"),
        ("{n}_pos_measured", "raw_{n}_pos"),
        ("arm_{n}_pos", "arm_{n}_pos_filtered"),
        ("qIn_{j}", "qOut_{j}"),
    ],
)
def test_a_series_beside_the_same_one_raw_filtered_or_commanded_counts_and_is_told(
    tmp_path: Path, plain: str, raw: str
) -> None:
    drive = "i_{j}" if "{j}" in plain else "{n}_current"
    header = ["t", *_joints(raw), *_joints(plain), *_joints(drive)]
    path = _csv(tmp_path, header, [_T, *(5.0 + _Q.T), *_Q.T, *_I.T])
    log = read_recording(path, None, _ROBOT, check=False)  # type: ignore[arg-type]
    np.testing.assert_array_equal(log.q, _Q)
    assert f"{_joints(plain)[0]} .. is read, not {_joints(raw)[0]} .." in log.notices


def test_a_share_of_a_rated_value_is_told_with_what_it_needs(tmp_path: Path) -> None:
    header = ["t", *_joints("q{j}_rad"), *_joints("torque {j} [%]")]
    path = _csv(tmp_path, header, [_T, *_Q.T, *_I.T])
    log = read_recording(path, None, _ROBOT, check=False)  # type: ignore[arg-type]
    (notice,) = [text for text in log.notices if "rated value" in text]
    assert "torque 1 [%] .. are in per cent of each drive's rated value" in notice
    form = tmp_path / "form.yaml"
    entry = notice.partition("motor_torque: ")[2].removesuffix(" (--log-format)")
    entry = entry.replace("rated torque of each joint, N m", "330, 150, 56")
    q = "q1_rad, q2_rad, q3_rad"
    lines = ["time: {columns: t}", f'position: {{columns: "{q}"}}', f"motor_torque: {entry}"]
    form.write_text("\n".join(lines))
    torque = read_recording(path, form).tau_J
    assert torque is not None
    np.testing.assert_allclose(torque, _I * [3.3, 1.5, 0.56], rtol=1e-12, atol=0)
