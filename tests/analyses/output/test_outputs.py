"""Result files: whole or not at all, plain, the same each time."""

import json
import math
import os
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np
import pytest
import yaml
from pydrake.multibody.plant import MultibodyPlantConfig

from wrenchsight.analyses.output.figures import new_figure
from wrenchsight.analyses.output.outputs import OutputFolder, plain
from wrenchsight.models.files.input_error import InputError


class Method(Enum):
    INVERSE = "inverse"


@dataclass
class Setting:
    method: Method
    gain: np.ndarray
    file: Path


def _names(folder):
    return sorted(path.name for path in folder.iterdir())


# ---- what may be written ----


def test_numpy_and_dataclasses_become_plain():
    value = {
        "setting": Setting(Method.INVERSE, np.array([1.5, 2.0]), Path("a") / "b"),
        "count": np.int64(3),
        "yes": np.bool_(True),
        "single": np.float64(0.1),
        "zero_dimensional": np.array(7.0),
        "matrix": np.arange(4).reshape(2, 2),
        "tuple": (1, "x", None),
        5: "key",
    }
    result = plain(value)
    assert result == {
        "setting": {"method": "inverse", "gain": [1.5, 2.0], "file": "a/b"},
        "count": 3,
        "yes": True,
        "single": 0.1,
        "zero_dimensional": 7.0,
        "matrix": [[0, 1], [2, 3]],
        "tuple": [1, "x", None],
        "5": "key",
    }
    assert type(result["count"]) is int
    assert type(result["single"]) is float
    assert result["yes"] is True
    json.dumps(result, allow_nan=False)


@pytest.mark.parametrize("value", [{"a": {1, 2}}, {"a": 1j}, {"a": b"x"}, {"a": object()}])
def test_a_value_without_a_plain_form_is_named(value):
    with pytest.raises(TypeError, match=r"^a: "):
        plain(value)


def test_a_configuration_of_drake_s_becomes_plain():
    assert plain(MultibodyPlantConfig(time_step=0.002))["time_step"] == 0.002


def test_json_round_trips_with_sorted_keys_and_full_precision(tmp_path):
    out = OutputFolder(tmp_path)
    value = {"z": 1 / 3, "a": {"y": [1.0, 2.5e-17], "x": []}, "e": {}, "list": [{"b": 1, "a": [2]}]}
    value["text"] = ['ü \n"', None, True, [[1], [2, 3]]]
    text = out.write_json("m.json", value).read_text()
    assert json.loads(text) == value
    order = json.loads(text, object_pairs_hook=lambda pairs: [k for k, _ in pairs])
    assert order == ["a", "e", "list", "text", "z"]
    assert '"y": [1.0, 2.5e-17]' in text
    assert text == out.write_json("m.json", dict(reversed(value.items()))).read_text()


def test_not_finite_values_become_null_and_are_listed(tmp_path):
    value = {"jcn": {"max": math.inf}, "rmse": np.array([1.0, np.nan, -np.inf]), "fine": 2.0}
    written = json.loads(OutputFolder(tmp_path).write_json("m.json", value).read_text())
    assert written["jcn"] == {"max": None}
    assert written["rmse"] == [1.0, None, None]
    assert written["not_finite"] == ["jcn.max", "rmse.1", "rmse.2"]


def test_yaml_reads_back_equal_and_is_deterministic(tmp_path):
    out = OutputFolder(tmp_path)
    value = {"b": 1e-05, "a": {"K_0": np.full(6, 20.0), "name": "no", "n": None}, "c": "1e5"}
    path = out.write_settings("config.yaml", value)
    assert yaml.safe_load(path.read_text()) == {
        "b": 1e-05,
        "a": {"K_0": [20.0] * 6, "name": "no", "n": None},
        "c": "1e5",
    }
    assert (
        path.read_bytes()
        == out.write_settings("c2.yaml", dict(reversed(value.items()))).read_bytes()
    )


def test_figures_go_below_figures(tmp_path):
    figure, _ = new_figure()
    path = OutputFolder(tmp_path).write_figure("bode", figure)
    assert path == tmp_path / "figures" / "bode.png"
    assert path.read_bytes().startswith(b"\x89PNG")


# ---- the folder ----


def test_the_folder_is_made_with_its_parents(tmp_path):
    assert OutputFolder(tmp_path / "a" / "b").path.is_dir()
    OutputFolder(tmp_path / "a" / "b")  # again is no error


@pytest.mark.parametrize("below", ["", "deeper/still"])
def test_a_file_in_the_way_is_named(tmp_path, below):
    (tmp_path / "out").write_text("precious")
    with pytest.raises(InputError) as caught:
        OutputFolder(tmp_path / "out" / below)
    assert str(tmp_path / "out") + ":" in str(caught.value)
    assert "--out" in str(caught.value)
    assert (tmp_path / "out").read_text() == "precious"


def test_a_folder_without_permission_is_refused(tmp_path, monkeypatch):
    # Patched rather than chmod: the administrator, as whom containers run, may write everywhere.
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(InputError, match="permission"):
        OutputFolder(tmp_path)


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path):
    with pytest.raises(InputError, match="cannot make this folder"):
        OutputFolder(tmp_path / ("x" * 300))


# ---- whole or not at all, as `whole_file` has it ----


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_error_while_writing_leaves_the_earlier_file(tmp_path, error):
    out = OutputFolder(tmp_path)
    out.write_text("a.txt", "old")
    with pytest.raises(error), out.atomic("a.txt") as partial:
        partial.write_text("half of the n")
        raise error
    assert (tmp_path / "a.txt").read_text() == "old"
    assert _names(tmp_path) == ["a.txt"]


def test_a_value_that_cannot_be_written_leaves_the_earlier_file(tmp_path):
    out = OutputFolder(tmp_path)
    out.write_json("m.json", {"a": 1})
    with pytest.raises(TypeError):
        out.write_json("m.json", {"a": 2, "b": object()})
    assert json.loads((tmp_path / "m.json").read_text()) == {"a": 1}
