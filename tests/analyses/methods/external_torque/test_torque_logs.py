"""Wrenches from logs of external torque: made-up ones with known answers, and a real arm's."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.csv as pa_csv
import pytest
import yaml

from wrenchsight.analyses.experiments.setups.panda_recordings.pose_logs import (
    knowledge_of_logs,
    read_forces,
    read_pose_logs,
)
from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.external_torque.torque_log import TorqueLog, is_torque_log
from wrenchsight.analyses.methods.external_torque.torque_logs import estimate_torque_logs
from wrenchsight.analyses.methods.reference_sensor.reference_config import ReferenceConfig
from wrenchsight.models.estimation.wrench_table import COLUMNS
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot

pytestmark = pytest.mark.long  # real recordings are read whole

NOISE = 0.03  # N m
FORCE = np.array([3.0, -6.0, -12.0])  # N, on the robot in axes of W, in the second half
RECORDINGS = tuple(f"panda_ati_gamma/data_pos_{i}.csv" for i in range(1, 11))
TURN = [np.pi / 2, 0.0, 0.0]  # of the pad's axes in the sensor's, those of the Jacobian


@pytest.fixture(scope="module")
def torque_log(panda: Robot, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Writes a log of a Panda that moves and is pushed; with q, with J, or both; Franka's sign."""

    def write(seed: int = 0, q: bool = True, J: bool = True, rows: int = 2000) -> Path:
        rng = np.random.default_rng(seed)
        t = np.arange(rows) / 100.0
        home = np.array([0.0, -0.4, 0.0, -1.9, 0.0, 1.6, 0.6])
        phase = rng.uniform(0.0, 6.0, 7)
        angles = home + 0.4 * np.sin(0.5 * t[:, None] + phase)
        jacobian = panda.chain.jacobian(angles)
        F = np.zeros((rows, 6))
        F[rows // 2 :, 3:] = FORCE
        torque = np.einsum("kij,ki->kj", jacobian, F) + NOISE * rng.normal(size=(rows, 7))
        columns = {"t": t}
        if q:
            columns |= {f"q{j + 1}": angles[:, j] for j in range(7)}
        columns |= {f"tau_ext_hat_filtered[{j}]": -torque[:, j] for j in range(7)}
        if J:
            linear_first = np.concatenate([jacobian[:, 3:], jacobian[:, :3]], axis=1)
            columns |= {
                f"jacobian_{i}_{j}": linear_first[:, i, j] for i in range(6) for j in range(7)
            }
        columns |= {f"f{axis}_sensor": -F[:, 3 + k] for k, axis in enumerate("xyz")}
        path = tmp_path_factory.mktemp("torque") / f"run_{seed}.csv"
        rows_of_text = np.column_stack(list(columns.values()))
        np.savetxt(path, rows_of_text, delimiter=",", header=",".join(columns), comments="")
        return path

    return write


def read_table(path: Path) -> dict[str, np.ndarray]:
    table = pa_csv.read_csv(path)
    return {name: table[name].to_numpy() for name in table.column_names}


def test_the_jacobian_alone_reads_force_noise_and_task(torque_log, tmp_path):
    path = torque_log(q=False)
    assert is_torque_log(path, None, "found")
    result = estimate_torque_logs([path], None, tmp_path)
    table = read_table(result.logs[0].table)
    assert tuple(table)[: len(COLUMNS)] == COLUMNS
    late = table["t"] >= 10.0
    assert table["contact"][late].mean() > 0.95
    assert not table["contact"][~late].any()
    assert result.logs[0].contacts[0].startswith("contact at t = 10.0")
    assert "tau_ext_7" in table
    for k, axis in enumerate(("fx", "fy", "fz")):
        mean, sd = table[axis][late].mean(), table[f"sd_{axis}"][late]
        assert mean == pytest.approx(FORCE[k], abs=0.1)  # a hundredth of the force and its prior
        inside = np.abs(table[axis] - np.where(late, FORCE[k], 0.0)) < 1.96 * table[f"sd_{axis}"]
        assert 0.9 < inside.mean() < 0.99
        assert (sd < 1.0).all()
    # One torque sd for all joints, of 2000 rows with one number each that no wrench explains.
    np.testing.assert_allclose(result.config.torque_sd, NOISE, rtol=0.06)
    assert result.metrics()["prior"]["rule"] == "evidence of the log"
    # Half the rows carry a force: its sd is the root of its mean square over three axes.
    expected = np.linalg.norm(FORCE) / np.sqrt(6.0)
    assert result.metrics()["prior"]["force_sd_n"] == pytest.approx(expected, rel=0.1)


def test_positions_and_a_robot_give_the_same_as_its_jacobian(torque_log, panda, tmp_path):
    config = EstimateConfig(prior="8,0.5", torque_sd=[NOISE])
    by_q = estimate_torque_logs([torque_log(J=False)], panda.source, tmp_path / "q", config=config)
    by_J = estimate_torque_logs([torque_log()], None, tmp_path / "J", config=config)
    one, other = (read_table(result.logs[0].table) for result in (by_q, by_J))
    for axis in ("fx", "fy", "fz", "mx", "my", "mz", "sd_fx"):
        # The text holds 18 digits.
        np.testing.assert_allclose(one[axis], other[axis], rtol=1e-9, atol=1e-9)
    assert by_J.config.torque_sd == [NOISE] * 7


@pytest.mark.parametrize(("contact_force", "is_warned"), [(5.0, False), (20.0, True)])
def test_a_sensor_of_one_force_is_warned_about_only_where_it_reads_no_contact(
    torque_log, tmp_path, contact_force, is_warned
):
    reference = ReferenceConfig("fz_sensor", contact_force=contact_force)
    config = EstimateConfig(reference=reference)
    result = estimate_torque_logs([torque_log(3, q=False)], None, tmp_path, config=config)
    warned = [sentence for sentence in result.warnings if "never reads more than" in sentence]
    assert len(warned) == is_warned, result.warnings
    assert all("more than 20 N" in sentence for sentence in warned)


def test_logs_are_read_together_and_each_has_its_table(torque_log, tmp_path):
    paths = [torque_log(seed, q=False) for seed in (1, 2)]
    reference = ReferenceConfig("fx_sensor,fy_sensor,fz_sensor", contact_force=1.0)
    result = estimate_torque_logs(paths, None, tmp_path, config=EstimateConfig(reference=reference))
    names = [log.table.name for log in result.logs]
    assert names == ["wrench_run_1.csv", "wrench_run_2.csv"]
    assert all((tmp_path / name).is_file() for name in names)
    metrics = result.metrics()
    # The sensor says what the robot does: found. It is exact, so that the sd says the error.
    assert result.logs[0].comparison is not None
    assert result.logs[0].comparison.mounting.sign == -1
    assert metrics["reference"]["mean_rmse_n"] == pytest.approx(
        np.mean([metrics["logs"][name]["reference"]["rows"]["rmse_n"] for name in metrics["logs"]])
    )
    np.testing.assert_allclose(metrics["reference"]["error_over_stated_sd"], 1.0, rtol=0.1)
    again = yaml.safe_load((tmp_path / "config.yaml").read_text())
    assert again["further_logs"] == [str(paths[1])]
    assert again["estimate"]["torque"] == "external"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"smooth": True}, ("--smooth", "leave it out")),
        ({"prior": "live"}, ("--prior", "--robot")),
        ({"torque_sign": "arm"}, ("torque sign", "robot or environment")),
        ({"torque_sd": [0.1, 0.2]}, ("--torque-sd", "expected 1 or 7")),
        ({"torque_sd": [-0.1]}, ("torque_sd", "positive")),
        ({"mcap": True}, ("--mcap", "place of E")),
    ],
)
def test_options_without_effect_on_external_torque_are_refused(
    torque_log, tmp_path, changes, words
):
    with pytest.raises(InputError) as caught:
        estimate_torque_logs(
            [torque_log(q=False, rows=300)], None, tmp_path, config=EstimateConfig(**changes)
        )
    for word in words:
        assert word in str(caught.value)
    assert not list(tmp_path.glob("wrench*"))


def test_positions_alone_need_a_robot(torque_log, tmp_path):
    with pytest.raises(InputError, match="no robot is named"):
        estimate_torque_logs([torque_log(J=False, rows=300)], None, tmp_path)


def test_a_log_of_another_arm_is_refused(torque_log, ur10e, tmp_path):
    with pytest.raises(InputError, match="7 joints, but ur10e has 6"):
        estimate_torque_logs([torque_log(rows=300)], ur10e.source, tmp_path)


def test_with_six_joints_a_note_states_that_the_noise_is_hardly_determined(ur10e, tmp_path):
    rng = np.random.default_rng(3)
    rows = 400
    q = np.array([0.3, -1.2, 1.4, -1.0, 1.2, 0.2]) + 0.3 * np.sin(
        0.01 * np.arange(rows)[:, None] * np.arange(1, 7)
    )
    torque = np.einsum(
        "kij,ki->kj", ur10e.chain.jacobian(q), np.tile([0, 0, 0, 0, 0, -20.0], (rows, 1))
    )
    names = ["time", *(f"q_{j}" for j in range(6)), *(f"external_torque_{j}" for j in range(6))]
    table = np.column_stack([np.arange(rows) / 100.0, q, torque + 0.1 * rng.normal(size=(rows, 6))])
    path = tmp_path / "iiwa.csv"
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="")
    result = estimate_torque_logs([path], "ur10e", tmp_path / "out")
    assert any("--torque-sd" in sentence for sentence in result.warnings)
    fz = read_table(result.logs[0].table)["fz"]
    assert fz.mean() == pytest.approx(-20.0, abs=0.5)


def test_the_command_says_what_the_experiment_says(data_holding, tmp_path):
    data = data_holding(*RECORDINGS)
    logs = read_pose_logs(data)
    knowledge = knowledge_of_logs(logs)
    expected = read_forces(logs, "bayesian", knowledge).metrics()
    columns = ",".join(f"ft_wrench_force_{axis}" for axis in "xyz")
    reference = ReferenceConfig(
        columns, frame="world", turn=TURN, sign="robot", delay="0", contact_force=1.0
    )
    result = estimate_torque_logs(
        [data / name for name in RECORDINGS],
        None,
        tmp_path,
        config=EstimateConfig(reference=reference),
    )
    metrics = result.metrics()
    assert metrics["prior"]["force_sd_n"] == knowledge.force_sd
    for key in ("mean_rmse_n", "rmse_n", "stated_sd_n", "error_over_stated_sd"):
        # The axes are turned by a matrix of sines: rounding.
        np.testing.assert_allclose(metrics["reference"][key], expected[key], rtol=1e-9)


def test_an_effort_without_gravity_is_said_to_be_the_external_torque(panda, tmp_path):
    """Not joint torque, as a log of currents has it."""
    t = np.arange(0.0, 6.0, 0.01)
    q = np.array(panda.home) + 0.3 * np.sin(t[:, None] + np.arange(7.0))
    v = 0.3 * np.cos(t[:, None] + np.arange(7.0))
    torque = 0.1 * np.random.default_rng(0).normal(size=q.shape)
    names = ["t", *(f"{key}_{name}" for key in ("position", "velocity", "effort")
                    for name in panda.joint_names)]  # fmt: skip
    log = tmp_path / "states.csv"
    rows = np.column_stack([t, q, v, torque])
    np.savetxt(log, rows, delimiter=",", header=",".join(names), comments="")
    result = estimate_torque_logs(
        [log], panda.source, tmp_path / "out", config=EstimateConfig(torque="external")
    )
    (notice,) = [text for text in result.notices if "gravity" in text]
    assert notice.startswith("effort holds no gravity torque (")
    assert notice.endswith("): it is read as the external torque")


def test_torque_beside_the_external_one_is_read_where_a_model_explains_it(torque_log, tmp_path):
    path = torque_log()
    columns = read_table(path)
    n = len(columns["t"])
    sensed = np.where(np.arange(n) == 7, np.nan, np.sin(0.1 * np.arange(n)))
    columns |= {f"tau_J[{j}]": (1.0 + j) * sensed for j in range(7)}
    both = tmp_path / "both.csv"
    rows_of_text = np.column_stack(list(columns.values()))
    np.savetxt(both, rows_of_text, delimiter=",", header=",".join(columns), comments="")
    assert is_torque_log(both, None, "found")
    assert not is_torque_log(both, None, "found", has_model=True)
    # What is wrong with the torque that is not read does not matter: a number lacks.
    log = TorqueLog(both, None, None, True, ReferenceConfig())
    assert sum(part.num_samples for part, _, _ in log.chunks(log.reader())) == n
