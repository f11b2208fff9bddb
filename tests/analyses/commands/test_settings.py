"""Settings of the commands: from a file, from options, and back from a result's config.yaml."""

import dataclasses
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from wrenchsight.analyses.__main__ import app
from wrenchsight.analyses.commands import estimate, options
from wrenchsight.analyses.commands.discovery import find_commands, load_command
from wrenchsight.analyses.methods.estimate import estimation
from wrenchsight.analyses.methods.estimate.estimate_config import (
    EstimateConfig,
    EstimateSettings,
    checked_config,
    with_observer,
)
from wrenchsight.analyses.methods.excite import excitation
from wrenchsight.analyses.methods.excite.excitation_config import ExciteSettings
from wrenchsight.analyses.methods.identify import identification
from wrenchsight.analyses.methods.identify.identification_config import IdentifySettings
from wrenchsight.analyses.methods.jcn_map import jcn_map
from wrenchsight.analyses.methods.jcn_map.jcn_map_settings import JcnMapSettings, SliceConfig
from wrenchsight.analyses.methods.place import placement
from wrenchsight.analyses.methods.place.place_settings import PlaceSettings
from wrenchsight.analyses.methods.redundancy import redundancy_results
from wrenchsight.analyses.methods.redundancy.redundancy_task import (
    RedundancySettings,
    RedundancyTask,
)
from wrenchsight.analyses.methods.simulate import simulation
from wrenchsight.analyses.methods.simulate.simulate_settings import SimulateSettings
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.models.files.bundled_files import task_file
from wrenchsight.models.files.configuration import load_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.planning.placement.placement_task import load_task

# What does the work of a command, by the command's name.
WORK = {
    "identify": (identification, "identify_logs"),
    "estimate": (estimation, "estimate_log"),
    "simulate": (simulation, "simulate_scenario"),
    "excite": (excitation, "excite_robot"),
    "jcn-map": (jcn_map, "jcn_map"),
    "place": (placement, "place_task"),
    "redundancy": (redundancy_results, "redundancy"),
}


@pytest.fixture
def call(monkeypatch, tmp_path):
    """Returns a function that runs a command up to its work, and gives what that would get."""

    def call(command, *arguments, config=None):
        seen = {}

        def note(*values, **named):
            seen.update(values=values, **named)
            raise KeyboardInterrupt

        monkeypatch.setattr(*WORK[command], note)
        if config is not None:
            folder = OutputFolder(tmp_path)
            path = folder.write_settings("config.yaml", config)
            arguments = (*arguments, "--config", path)
        result = CliRunner().invoke(app, [command, *map(str, arguments)])
        return seen if result.exit_code == 130 else result

    return call


def _estimate_settings():
    settings = EstimateSettings(log="log.csv", robot="ur10e", model="m.yaml")
    observer = settings.estimate.estimator.observer
    observer.K_0, observer.torque_samples = [5.0, 6.0], "trapezoidal"
    settings.estimate.estimator.reconstruction.max_force_sd = 7.0
    return settings


def test_a_config_file_holds_all_settings_of_a_run(call):
    seen = call("estimate", config=_estimate_settings())["values"]
    expected = _estimate_settings()
    assert seen[:3] == (Path("log.csv"), "ur10e", Path("m.yaml"))
    assert seen[4:6] == (None, expected.estimate)


def test_options_count_before_the_file(call):
    arguments = ("other.csv", "--robot", "panda", "--k0", "30", "--no-check")
    seen = call("estimate", *arguments, config=_estimate_settings())["values"]
    expected = _estimate_settings().estimate
    expected.estimator.observer.K_0, expected.check = [30.0], False
    assert seen[:3] == (Path("other.csv"), "panda", Path("m.yaml"))
    assert seen[5] == expected


def test_an_option_that_says_the_default_counts_before_the_file(call):
    config = EstimateConfig()
    method = config.estimator.reconstruction.method
    settings = _estimate_settings()
    settings.estimate.estimator.reconstruction.method = "damped"
    seen = call("estimate", "--method", method, config=settings)["values"]
    assert seen[5].estimator.reconstruction.method == method


def test_a_part_of_a_file_leaves_the_rest_at_its_defaults(call, tmp_path):
    config = {"estimate": {"estimator": {"observer": {"K_0": [15.0]}}}}
    seen = call("estimate", "log.csv", "--robot", "r", config=config)["values"]
    expected = EstimateConfig()
    expected.estimator.observer.K_0 = [15.0]
    assert seen[5] == expected  # also the time step, whose default is the log's own


@pytest.mark.parametrize(
    ("config", "words"),
    [
        ({"estimate": {"estimator": {"observer": {"k_0": [1.0]}}}}, ("line 4", "k_0", '"K_0"?')),
        ({"robott": "ur10e"}, ("line 1", "robott", '"robot"?')),
        ({"estimate": {"check": 3}}, ("check", "true or false")),
    ],
)
def test_a_mistyped_key_is_one_line(call, tmp_path, config, words):
    path = tmp_path / "settings.yaml"
    path.write_text(yaml.safe_dump(config, default_flow_style=False))
    result = call("estimate", "log.csv", "--robot", "r", "--config", path)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    for word in ("settings.yaml", *words):
        assert word in result.stderr


def test_a_file_that_is_not_there_is_one_line(call):
    result = call("estimate", "log.csv", "--robot", "r", "--config", "nowhere.yaml")
    assert (result.exit_code, result.stderr) == (2, "nowhere.yaml: no such file; check the path\n")


def test_a_setting_given_nowhere_is_a_usage_error(call):
    result = call("estimate", "log.csv", config={"estimate": {"max_gap": 0.5}})
    assert result.exit_code == 2
    assert "--robot" in result.stderr


def test_every_command_with_settings_reads_them_from_a_file(call):
    identify = IdentifySettings(robot="r", logs=["a", "b"], validate=["c"])
    identify.identification.num_passes = 7
    assert call("identify", config=identify)["values"][0] == identify
    assert not call("identify", "--no-check", config=identify)["values"][0].check

    excite = ExciteSettings(robot="r", validation=False)
    excite.excitation.limits.floor, excite.excitation.num_starts = None, 3
    assert call("excite", config=excite)["values"][2:4] == (excite.excitation, False)

    simulate = SimulateSettings(scenario="a.yaml:One", duration_s=2.0, record=False)
    assert call("simulate", config=simulate)["values"][0] == simulate
    seen = call("simulate", "--name", "Two", config=simulate)
    assert seen["values"][0].scenario == "a.yaml:Two"

    cut = SliceConfig("x", 0.4, [0.0, 1.0, 0.0], num_points=5)
    settings = JcnMapSettings(num_samples=9, slice=cut)
    expected = dataclasses.replace(settings, slice=dataclasses.replace(cut, cone_deg=12.0))
    assert call("jcn-map", "--cone-deg", 12, config=settings)["values"][0] == expected
    assert call("jcn-map", "--cone-deg", 12)["values"][0].slice is None

    task, _ = load_task("linear_path")
    place = PlaceSettings(task="linear_path", solver="ipopt", task_content=task)
    assert call("place", config=place)["values"][0] == place
    other = call("place", "--task", "other", config=place)["values"][0]
    assert other == dataclasses.replace(place, task="other", task_content=None)

    content = load_configuration(task_file("blade_path", "redundancy"), RedundancyTask)
    content.model = Path("model.yaml")
    settings = RedundancySettings(task="blade_path", robot="ur10e", task_content=content)
    assert call("redundancy", config=settings)["values"][0] == settings


def test_without_a_file_the_settings_are_the_defaults(call):
    assert call("excite", "--robot", "r")["values"][2] == ExciteSettings().excitation
    assert call("estimate", "a", "--robot", "r")["values"][5] == EstimateConfig()
    assert call("identify", "a", "--robot", "r")["values"][0] == IdentifySettings(
        robot="r", logs=["a"]
    )
    assert call("jcn-map", "--slice", "z=0.3")["values"][0].slice == SliceConfig("z", 0.3)


@pytest.mark.parametrize("words", [("z=0.3,0.4",), ("z=up",), ("z",)])
def test_a_slice_that_is_no_plane_is_one_line(call, words):
    result = call("jcn-map", "--slice", *words)
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert "--slice" in result.stderr


def test_a_command_that_has_settings_takes_a_file_of_them():
    for name, entry in find_commands().items():
        options = {parameter.name for parameter in load_command(entry).params}
        settings_options = getattr(import_module(entry.module), "OPTIONS", None)
        assert ("config" in options) == (settings_options is not None), name
        assert {option.parameter for option in settings_options or ()} <= options, name


def test_help_shows_what_people_need_and_help_all_every_option():
    shown, every = (
        CliRunner().invoke(app, ["estimate", word], env={"COLUMNS": "200"}).stdout
        for word in ("--help", "--help-all")
    )
    hidden = [option.spelling for option in estimate.OPTIONS if not option.shown]
    assert len(hidden) > 20
    for option in estimate.OPTIONS:
        assert option.argument or f"{option.spelling} " in every, option
    assert not [spelling for spelling in hidden if f"{spelling} " in shown]
    # The field's words, its unit last, and its default.
    gap = next(line for line in every.splitlines() if "--max-gap " in line)
    assert "Longest gap that is bridged" in gap
    assert f"[default: {EstimateConfig().max_gap}]" in every


def test_an_address_begins_a_sentence_of_the_help_as_it_is_typed():
    shown = CliRunner().invoke(app, ["watch", "--help"], env={"COLUMNS": "200"}).stdout
    assert "rtde://HOST[:PORT]" in shown
    assert "Rtde" not in shown


def test_options_reach_the_estimate(call, tmp_path):
    """Also those that --help does not show."""
    arguments = ("log.csv", "--robot", "r", "--model", "m.yaml", "--out", tmp_path)
    arguments += ("--method", "inverse", "--k0", "5,20", "--prior-force-sd", 30)
    arguments += ("--prior-moment-sd", 2, "--log-format", "f", "--step", 0.001)
    arguments += ("--max-gap", 0.5, "--no-check", "--torque-samples", "trapezoidal")
    arguments += ("--damping", 0.1, "--truncation", 0.01, "--max-force-sd", 12)
    seen = call("estimate", *arguments)["values"]
    assert seen[:5] == (Path("log.csv"), "r", Path("m.yaml"), tmp_path, "f")
    expected = EstimateConfig(max_gap=0.5, check=False)
    observer, reconstruction = expected.estimator.observer, expected.estimator.reconstruction
    observer.K_0, observer.time_step, observer.torque_samples = [5.0, 20.0], 0.001, "trapezoidal"
    reconstruction.method = "inverse"
    reconstruction.prior_force_sd, reconstruction.prior_moment_sd = 30.0, 2.0
    reconstruction.max_force_sd = 12.0
    reconstruction.damping, reconstruction.truncation = 0.1, 0.01
    assert seen[5] == expected


@pytest.mark.parametrize(
    ("scenario", "expected"),
    [
        ((), "Default"),
        (("--scenario", "HandGuiding"), "HandGuiding"),
        (("--scenario", "file.yaml"), "file.yaml"),
        (("--scenario", "file.yaml", "--name", "Mine"), "file.yaml:Mine"),
    ],
)
def test_options_reach_the_simulation(call, tmp_path, scenario, expected):
    arguments = ("--robot", "r", "--model", "m", "--out", tmp_path, "--duration", 2.5, "--seed", 4)
    arguments += ("--quick", "--no-recording", "--graphviz", "--truth", "plain")
    asked_for, out, _progress = call("simulate", *scenario, *arguments)["values"]
    assert out == tmp_path
    assert asked_for == SimulateSettings(
        scenario=expected,
        robot="r",
        model="m",
        truth="plain",
        seed=4,
        duration_s=2.5,
        quick=True,
        record=False,
        graph=True,
    )


@pytest.mark.parametrize(
    ("arguments", "logs", "validate"),
    [
        (("a", "b", "--validate", "c", "d", "--robot", "r"), ["a", "b"], ["c", "d"]),
        (("--robot", "r", "a", "--validate", "c", "--validate", "d"), ["a"], ["c", "d"]),
        (("--validate", "c", "d", "--robot", "r", "a"), ["a"], ["c", "d"]),
        (("--validate=c", "a", "b", "--robot", "r"), ["a", "b"], ["c"]),
        (("--robot", "r", "--validate", "c", "--", "a"), ["a"], ["c"]),
        (("a", "--robot", "r"), ["a"], []),
    ],
)
def test_validate_takes_several_logs(call, arguments, logs, validate):
    settings = call("identify", *arguments)["values"][0]
    assert (settings.logs, settings.validate) == (logs, validate)


# ---- the observer of `estimate` ----


KALMAN = KalmanObserverConfig(0.3, 0.004, "trapezoidal")


@pytest.mark.parametrize(
    ("words", "config", "expected"),
    [
        ("", None, MomentumObserverConfig(time_step=0.0, torque_samples="trapezoidal")),
        (
            "--observer kalman --bandwidth 0.1 --torque-samples trapezoidal",
            None,
            KalmanObserverConfig(0.1, 0.0, "trapezoidal"),
        ),
        (
            "--observer momentum --k0 30,40 --step 0.002",
            None,
            MomentumObserverConfig([30.0, 40.0], 0.002, "trapezoidal"),
        ),
        ("", KALMAN, KALMAN),
        ("--bandwidth 0.5", KALMAN, KalmanObserverConfig(0.5, 0.004, "trapezoidal")),
        (
            "--observer momentum --k0 7",
            KALMAN,
            MomentumObserverConfig([7.0], 0.004, "trapezoidal"),
        ),
    ],
)
def test_an_observer_by_its_name_and_from_a_file(call, words, config, expected):
    settings = EstimateSettings(log="log.csv", robot="r")
    if config is not None:
        settings.estimate.estimator.observer = config
    seen = call("estimate", *words.split(), config=settings)["values"]
    assert seen[5].estimator.observer == expected


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("kalman --k0 7", "--k0: KalmanObserverConfig has no K_0; leave it out\n"),
        ("luenberger", "give momentum or kalman"),
    ],
)
def test_a_setting_of_another_observer_is_one_line(call, words, message):
    result = call("estimate", "log.csv", "--robot", "r", "--observer", *words.split())
    assert result.exit_code == 2
    assert message in result.stderr


def test_a_method_that_the_observer_does_not_know(ur10e):
    config = with_observer(EstimateConfig(), "kalman")
    config.estimator.reconstruction.method = "damped"
    with pytest.raises(InputError, match="the kalman observer has no prior"):
        checked_config(config, ur10e)
    config.estimator.reconstruction.method = "force_only"
    assert checked_config(config, ur10e) is config


# ---- help, and files ----


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("s, longest gap; 0: none", "Longest gap; 0: none (s)."),
        ("rad (m), from the limits", "From the limits (rad (m))."),
        ("model.yaml of `identify`", "model.yaml of `identify`."),
        ("some share of it", "Some share of it."),
    ],
)
def test_a_fields_words_become_a_sentence_with_the_unit_last(words, sentence):
    assert options._sentence(words) == sentence


@dataclasses.dataclass
class _Plain:
    K_0: float = 1.0


@dataclasses.dataclass
class _Other:
    gain: float = 2.0


@dataclasses.dataclass
class _Settings:
    observer: _Plain | _Other = dataclasses.field(default_factory=_Plain)
    floor: float | None = 0.0


@pytest.mark.parametrize("settings", [_Settings(), _Settings(_Other(3.0), None)])
def test_the_config_of_a_result_is_read_back(tmp_path, settings):
    """Also one of several kinds, and nothing where the default is something."""
    path = OutputFolder(tmp_path).write_settings("config.yaml", settings)
    assert load_configuration(path, _Settings) == settings
