"""The data set's own statements about its sensor, repeated from its columns."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.analyses.experiments.setups.lara8_recordings.lara8_reading import (
    FOLDER,
    Lara8Log,
    controller_friction,
    read_logs,
)
from wrenchsight.models.files.input_error import InputError

_FILES = ("joint3_sweep", "jog_joint1_unloaded")


@pytest.fixture(scope="module")
def logs(some_data: Callable[..., Path]) -> dict[str, Lara8Log]:
    names = [f"{name}.csv" for name in _FILES] + ["robot.yaml", "robot.urdf"]
    files = [f"{FOLDER}/{name}" for name in names]
    return {log.name: log for log in read_logs(some_data(*files))}


def test_the_sensors_zero_is_the_one_stated(logs: dict[str, Lara8Log]) -> None:
    assert np.allclose(logs["joint3_sweep"].mounting.tare[:3], [0.37, 2.48, 9.60], atol=5e-3)
    assert np.allclose(logs["jog_joint1_unloaded"].mounting.tare[:3], [-0.32, 0, -0.94], atol=5e-3)


def test_the_mounting_gives_the_wrench_that_the_data_set_has(logs: dict[str, Lara8Log]) -> None:
    """Its axes and its sign: where nothing moves, its delay does not count."""
    log = logs["jog_joint1_unloaded"]
    still = slice(0, 500)  # 2 s
    given = log.recording.extra["wrench"][still, :3]
    assert np.allclose(log.sensor_wrench()[still, :3], given, atol=0.2)  # the sensor's noise
    sweep = logs["joint3_sweep"]
    weight = sweep.sensor_wrench()[:, 2]
    assert np.nanmean(weight) == pytest.approx(-33.2, abs=0.2)
    # Its delay taken off, the weight of a load that turns stays downwards.
    given = sweep.recording.extra["wrench"]
    assert np.nanstd(sweep.sensor_wrench()[:, 1]) < 1.1 * given[:, 1].std()


def test_friction_is_the_controllers_law_at_speed() -> None:
    """s c + b s (d |v| + tanh(w |v|)) without load, by the data set's numbers."""
    v = np.array([[0.14, -0.15, 0.5, 0.4, -0.6, 0.3]])
    c = np.array([13.15, 14.01, 6.53, 9.48, 2.51, 1.60])
    b = np.array([3.113, 5.332, 1.149, 0.954, 0.264, 0.288])
    w = np.array([12.3, 12.3, 54.5, 54.5, 4.3, 12.8])
    d = np.array([9.5, 9.5, 12.0, 12.0, 11.9, 7.0])
    s = np.sign(v)
    stated = s * c + b * s * (d * np.abs(v) + np.tanh(w * np.abs(v)))
    law = controller_friction("any", load_share=np.zeros(6))
    ours = s * (law.coulomb + law.stribeck * np.exp(-((v / law.stribeck_velocity) ** 2)))
    ours += law.coulomb_viscous.viscous * v
    # tanh(x) and 1 - exp(-x^2) differ by at most 0.2, times b of at most 5.3 N m.
    assert np.allclose(ours, stated, atol=0.5)
    sweep = controller_friction("joint3_sweep").coulomb_viscous.viscous[2]
    assert sweep == pytest.approx(1.149 * 12 - 5.36)


def test_a_folder_without_recordings(tmp_path: Path) -> None:
    (tmp_path / FOLDER).mkdir()
    with pytest.raises(InputError, match="holds none of joint3_sweep"):
        read_logs(tmp_path)
