"""A real Panda that a hand touches, link by link: found, named, and its torque's sign."""

from itertools import pairwise

import numpy as np
import pyarrow.csv as pa_csv
import pytest

from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.external_torque.torque_logs import estimate_torque_logs
from wrenchsight.models.files.input_error import InputError

pytestmark = pytest.mark.long  # real recordings are read whole

LATE = 0.15  # s that a change of the label leaves
SENSORS = """
time: {columns: t}
position: {columns: "q{1..7}"}
velocity: {columns: "v{1..7}"}
motor_torque: {columns: "tau_J{1..7}"}
"""


def touch(name: str) -> str:
    return f"link_contact/panda_{name}.csv"


def right_share(t: np.ndarray, label: np.ndarray, contact: np.ndarray) -> float:
    """Of samples, by the source's protocol: up to LATE of each stretch does not count until the
    first right answer.
    """
    right, counted = 0, 0
    edges = np.r_[0, np.flatnonzero(np.diff(label.astype(int))) + 1, len(t)]
    for begin, end in pairwise(edges):
        same = contact[begin:end] == label[begin]
        first = int(np.argmax(same)) if same.any() else end - begin
        skipped = min(first, int(np.searchsorted(t[begin:end], t[begin] + LATE)))
        right, counted = right + int(same[skipped:].sum()), counted + end - begin - skipped
    return right / counted


@pytest.mark.parametrize(("name", "link"), [("link2_f2", 2), ("link5_c3", 5), ("link7_a4", 7)])
@pytest.mark.parametrize("sensed", [False, True])
def test_touches_are_found_and_their_link_is_named(data, tmp_path, name, link, sensed):
    log = data(touch(name))
    description = tmp_path / "sensors.yaml"
    description.write_text(SENSORS)
    result = estimate_torque_logs(
        [log],
        "panda",
        tmp_path / "out",
        description if sensed else None,
        config=EstimateConfig(torque="external"),
    )
    rows = pa_csv.read_csv(log)
    t, label = (rows[key].to_numpy() for key in ("t", "contact"))
    table = pa_csv.read_csv(result.logs[0].table)
    at = np.searchsorted(table["t"].to_numpy(), t + 1e-6) - 1
    contact = table["contact"].to_numpy()[np.clip(at, 0, None)] == 1
    assert right_share(t, label == 1, contact) > 0.95
    metrics = result.metrics()
    touches = metrics["contact"]["contacts"]
    begins = t[1:][np.diff(label) == 1]
    assert len(touches) == len(begins)  # all found, no false one
    named = [[candidate["link"] for candidate in each["links"]] for each in touches]
    assert np.mean([link in each for each in named]) > 0.9
    assert max(len(each) for each in named) <= 3
    assert all(each["not_at_e"] == (link < 6) for each in touches)
    misfit, valid = (table[key].to_numpy() == 1 for key in ("misfit", "valid"))
    assert not (misfit & valid).any()
    assert metrics["torque_sign"]["correlation"] > 0.9
    assert not [line for line in result.warnings if "contradicted" in line]


def test_a_torque_of_the_wrong_sign_is_reported(data, tmp_path):
    config = EstimateConfig(torque_sign="environment")
    result = estimate_torque_logs([data(touch("link4_d3"))], "panda", tmp_path, config=config)
    (line,) = [line for line in result.warnings if "contradicted" in line]
    assert "--torque-sign robot" in line
    assert result.metrics()["torque_sign"]["correlation"] < -0.9


def test_sensors_need_a_robot(tmp_path):
    log = tmp_path / "log.csv"
    header = ["t", *(f"q{j}" for j in range(1, 8)), *(f"tau_J{j}" for j in range(1, 8))]
    rows = np.column_stack([np.arange(50) / 100.0, np.zeros((50, 14))])
    np.savetxt(log, rows, delimiter=",", header=",".join(header), comments="")
    description = tmp_path / "sensors.yaml"
    description.write_text(SENSORS.replace('velocity: {columns: "v{1..7}"}\n', ""))
    with pytest.raises(InputError, match="name the robot"):
        estimate_torque_logs([log], None, tmp_path / "out", description)
