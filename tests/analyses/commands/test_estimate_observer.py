"""estimate --observer: which observer, with which settings, from options and from a file."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from wrenchsight.analyses.__main__ import app
from wrenchsight.analyses.methods.reading import estimation
from wrenchsight.analyses.methods.reading.estimate_config import (
    EstimateConfig,
    EstimateSettings,
    checked_config,
    with_observer,
)
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.observers.observer_kinds import OBSERVERS, kind_name
from wrenchsight.models.robot.robot import Robot


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., Any]:
    """Returns a function that runs the command up to its work, and gives its configuration."""

    def call(*arguments: str, settings: EstimateSettings | None = None) -> Any:
        seen: list[Any] = []

        def note(*values: Any) -> None:
            seen.extend(values)
            raise KeyboardInterrupt

        monkeypatch.setattr(estimation, "estimate_log", note)
        words = ["estimate", "log.csv", "--robot", "r", *arguments]
        if settings is not None:
            words += ["--config", str(OutputFolder(tmp_path).write_settings("c.yaml", settings))]
        result = CliRunner().invoke(app, words)
        return seen[5].estimator.observer if result.exit_code == 130 else result

    return call


def test_the_names_of_the_kinds() -> None:
    assert [kind_name(kind) for kind in OBSERVERS] == ["momentum", "kalman"]


def test_an_observer_by_its_name(call: Callable[..., Any]) -> None:
    assert call() == MomentumObserverConfig(time_step=0.0)
    found = call("--observer", "kalman", "--bandwidth", "0.1", "--torque-samples", "trapezoidal")
    assert found == KalmanObserverConfig(0.1, 0.0, "trapezoidal")
    found = call("--observer", "momentum", "--k0", "30,40", "--step", "0.002")
    assert found == MomentumObserverConfig([30.0, 40.0], 0.002)


def test_options_count_before_the_file(call: Callable[..., Any]) -> None:
    settings = EstimateSettings(log="log.csv", robot="r")
    settings.estimate.estimator.observer = KalmanObserverConfig(0.3, 0.004, "trapezoidal")
    assert call(settings=settings) == KalmanObserverConfig(0.3, 0.004, "trapezoidal")
    found = call("--bandwidth", "0.5", settings=settings)
    assert found == KalmanObserverConfig(0.5, 0.004, "trapezoidal")
    found = call("--observer", "momentum", "--k0", "7", settings=settings)
    assert found == MomentumObserverConfig([7.0], 0.004, "trapezoidal")


def test_a_setting_of_another_observer_is_one_line(call: Callable[..., Any]) -> None:
    result = call("--observer", "kalman", "--k0", "7")
    assert result.exit_code == 2
    assert result.stderr == "--k0: KalmanObserverConfig has no K_0; leave it out\n"
    result = call("--observer", "luenberger")
    assert result.exit_code == 2
    assert "give momentum or kalman" in result.stderr


def test_a_method_that_the_observer_does_not_know(ur10e: Robot) -> None:
    config = with_observer(EstimateConfig(), "kalman")
    config.estimator.reconstruction.method = "damped"
    with pytest.raises(InputError, match="the kalman observer has no prior"):
        checked_config(config, ur10e)
    config.estimator.reconstruction.method = "force_only"
    assert checked_config(config, ur10e) is config
