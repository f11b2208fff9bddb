"""Logs of external torque, recognised by their columns."""

from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.layouts.external_torque import external_torque_layout, jacobians
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

LOG = Path("log.csv")


def layout_of(names: list[str]):
    return external_torque_layout(names, LOG)


@pytest.mark.parametrize(
    "torque",
    [
        [f"tau_ext_{j}" for j in range(7)],
        [f"tau_ext.{j + 1}" for j in range(7)],
        [f"/franka_states/tau_ext_hat_filtered[{j}]" for j in range(7)],
        [f"ExternalTorque_{j}" for j in range(7)],
    ],
)
def test_torques_are_recognised_by_their_usual_names(torque: list[str]) -> None:
    positions = [f"q{j + 1}" for j in range(7)]
    layout = layout_of(["other", "time", *torque[::-1], *positions])
    assert layout is not None
    assert layout.form.time.columns == "2"
    # In the order of the joints, not of the columns.
    assert layout.form.extra["tau_ext"].columns == "9, 8, 7, 6, 5, 4, 3"
    assert layout.form.position is not None


def test_the_sign_of_franka_torques_is_changed_with_a_notice() -> None:
    names = ["t"] + [f"q{j}" for j in range(7)] + [f"dq_{j}" for j in range(7)]
    franka = layout_of(names + [f"tau_ext_hat_filtered_{j}" for j in range(7)])
    plain = layout_of(names + [f"tau_ext_{j}" for j in range(7)])
    assert franka is not None
    assert plain is not None
    assert franka.form.extra["tau_ext"].exerted_on == "environment"
    assert "--torque-sign robot" in franka.notices[1]
    assert plain.form.extra["tau_ext"].exerted_on == "robot"
    assert franka.form.velocity is not None
    assert franka.form.velocity.columns == "9, 10, 11, 12, 13, 14, 15"


def test_joint_torques_beside_the_external_ones_are_the_motor_torque() -> None:
    names = ["t"] + [f"q.{j}" for j in range(7)] + [f"tau_ext_hat_filtered.{j}" for j in range(7)]
    alone = layout_of([*names, *(f"dtau_J.{j}" for j in range(7))])
    beside = layout_of([*names, *(f"tau_J.{j}" for j in range(7)[::-1])])
    assert alone is not None
    assert beside is not None
    assert alone.form.motor_torque is None
    assert len(beside.notices) == len(alone.notices) + 1
    assert "tau_J.0 .. tau_J.6, the measured joint torques, are read" in beside.notices[-1]
    assert beside.form.motor_torque is not None
    assert beside.form.motor_torque.columns == "22, 21, 20, 19, 18, 17, 16"
    assert "tau_ext" in beside.form.extra


def test_jacobian_columns_have_two_indices_or_one() -> None:
    torque = ["t", "tau_ext_0", "tau_ext_1"]
    two_indices = [f"J_{i + 1}_{j + 1}" for i in range(6) for j in range(2)]
    one_index = [f"jacobian.{k + 1}" for k in range(12)]
    for entries in (two_indices, one_index):
        layout = layout_of(torque + entries)
        assert layout is not None
        assert layout.form.extra["jacobian"].shape == [6, 2]
        assert layout.form.extra["jacobian"].columns == ", ".join(str(4 + k) for k in range(12))


def test_logs_without_torque_or_time_are_not_recognised() -> None:
    assert layout_of(["t", "q1", "v1", "i1"]) is None
    assert layout_of(["tau_ext_1", "q1"]) is None  # without time


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["t", "tau_ext_1", "tau_ext_2"], ("neither a Jacobian nor positions", "q1..")),
        (["t", "tau_ext_0", "tau_ext_2", "q1", "q2"], ("lacks tau_ext_1",)),
        (["t", "tau_ext_0", "tau_ext_1", "q1"], ("lacks q2",)),
        (["t", "tau_ext_0", "J_0_0", "J_1_0"], ("lacks J_2_0", "3 more")),
    ],
)
def test_a_missing_column_is_named(names: list[str], words: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as caught:
        layout_of(names)
    for word in words:
        assert word in str(caught.value)


def recording(J: np.ndarray) -> Recording:
    empty = np.zeros((len(J), 0))
    extra = {"jacobian": J, "tau_ext": np.zeros((len(J), J.shape[2]))}
    return Recording(np.arange(len(J)) * 0.1, empty, empty, empty, "log.csv", extra=extra)


@pytest.fixture(scope="module")
def J(panda: Robot) -> np.ndarray:
    """(20, 6, 7) rows [angular; linear]."""
    rng = np.random.default_rng(1)
    return panda.chain.jacobian(panda.home + 0.2 * rng.normal(size=(20, 7)))


def linear_first(J: np.ndarray) -> np.ndarray:
    return np.concatenate([J[:, 3:], J[:, :3]], axis=1)


def test_a_jacobian_with_linear_rows_first_is_read(J: np.ndarray) -> None:
    np.testing.assert_array_equal(jacobians(recording(linear_first(J))), J)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda J: J, "angular rows first"),
        (lambda J: linear_first(J).transpose(0, 2, 1).reshape(-1, 6, 7), "column by column"),
        (lambda J: J.transpose(0, 2, 1).reshape(-1, 6, 7), "column by column"),
        (lambda J: np.degrees(linear_first(J)), "expected 1"),
    ],
)
def test_another_order_or_unit_of_a_jacobian_is_refused(J: np.ndarray, change, word: str) -> None:
    with pytest.raises(InputError, match=word):
        jacobians(recording(change(J)))


def test_a_jacobian_may_have_a_prismatic_joint_and_a_missing_row(J: np.ndarray) -> None:
    J = J.copy()
    J[:, :, 2] = [0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    J[3] = np.nan
    jacobians(recording(linear_first(J)))
