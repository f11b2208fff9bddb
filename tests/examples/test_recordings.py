"""The sets of real recordings in the repository: their licences, their size, their numbers."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest

from wrenchsight.analyses.data_sets.places import BUNDLED
from wrenchsight.analyses.data_sets.registry import DATA_SETS
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot

SETS = ("link_contact", "neura_lara8", "panda_ati_gamma")
MOST_BYTES = 8e6  # of all sets together
RECORDINGS = sorted(path.relative_to(BUNDLED) for path in BUNDLED.glob("*/*.parquet"))


def test_each_set_has_its_licence_and_its_source():
    assert sorted(path.name for path in BUNDLED.iterdir() if path.is_dir()) == list(SETS)
    words = {"Apache-2.0": "Apache License", "MIT": "MIT License", "BSD-3-Clause": "BSD 3-Clause"}
    for name in SETS:
        assert words[DATA_SETS[name].licence] in (BUNDLED / name / "LICENSE").read_text()
        source = (BUNDLED / name / "SOURCE.md").read_text()
        assert DATA_SETS[name].source in source
        assert "commit" in source
        assert "Changed:" in source


def test_they_are_small():
    assert sum(path.stat().st_size for path in BUNDLED.rglob("*") if path.is_file()) < MOST_BYTES


@pytest.mark.parametrize("name", RECORDINGS, ids=str)
def test_every_number_is_that_of_the_csv_file(data, name: Path):
    given = pa_csv.read_csv(data(str(name.with_suffix(".csv"))))
    stored = pq.read_table(BUNDLED / name)
    assert set(given.column_names) - set(stored.column_names) <= {"kind"}  # a text
    for column in stored.column_names:
        np.testing.assert_array_equal(stored[column].to_numpy(), given[column].to_numpy())


def test_the_script_keeps_every_bit(tmp_path):
    path = BUNDLED / "to_parquet.py"
    spec = spec_from_file_location("to_parquet", path)
    script = module_from_spec(spec)
    spec.loader.exec_module(script)
    rng = np.random.default_rng(5)
    exact = rng.normal(size=500)
    rounded = rng.normal(size=500).round(3)
    table = pa.table({"x": exact, "y": rounded, "n": rng.integers(0, 3, 500), "word": ["a"] * 500})
    (tmp_path / "csv").mkdir()
    pa_csv.write_csv(table, tmp_path / "csv" / "log.csv")
    (tmp_path / "csv" / "list.csv").write_text("name,n\nlog,500\n")
    script.convert(tmp_path / "csv", tmp_path / "out")
    stored = pq.read_table(tmp_path / "out" / "log.parquet")
    assert stored.column_names == ["x", "y", "n"]
    np.testing.assert_array_equal(stored["x"].to_numpy(), exact)
    np.testing.assert_array_equal(stored["y"].to_numpy(), rounded)
    assert (tmp_path / "out" / "list.csv").read_text() == "name,n\nlog,500\n"


@pytest.fixture(scope="module")
def fitted() -> Robot:
    return Robot.load(BUNDLED / "neura_lara8" / "fitted_robot.yaml")


@pytest.mark.parametrize("name", [name for name in RECORDINGS if name.parts[0] == "neura_lara8"])
def test_the_fitted_lara_8_is_the_one_recorded(fitted, name):
    """Its flange to 0.01 mm; its controller's rigid-body torque but for spikes at starts."""
    table = pq.read_table(BUNDLED / name)
    log = read_recording(BUNDLED / name, "neura-lara8")
    _, p_WE = fitted.chain.pose(log.q)
    recorded = np.column_stack([table[key] for key in ("px", "py", "pz")])
    assert np.abs(p_WE - recorded).max() < 1e-5
    model = fitted.chain.inverse_dynamics(log.q, log.extra["v_target"], log.extra["a_target"])
    error = np.abs(model - log.extra["tau_model"])
    assert np.median(error, axis=0).max() < 0.3  # N m
