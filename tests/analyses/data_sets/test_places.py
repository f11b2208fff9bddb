"""Where a set of recordings is looked for, and in which order."""

from pathlib import Path

import pytest

from wrenchsight.analyses.data_sets import places
from wrenchsight.analyses.data_sets.advice import how_to_get_all, missing_recordings
from wrenchsight.analyses.data_sets.fetching import fetch_data_sets
from wrenchsight.analyses.data_sets.places import (
    data_set_folder,
    find_data_set,
    given_folder,
    recording_file,
)
from wrenchsight.analyses.data_sets.registry import DATA_SETS, data_set
from wrenchsight.models.files.input_error import InputError


@pytest.fixture
def bundled(tmp_path, monkeypatch) -> Path:
    """The repository's own sets: `toy`."""
    (tmp_path / "bundled" / "toy").mkdir(parents=True)
    monkeypatch.setattr(places, "BUNDLED", tmp_path / "bundled")
    return tmp_path / "bundled"


def test_given_comes_before_fetched_before_bundled(host, cache, bundled, tmp_path):
    given = tmp_path / "given"
    assert find_data_set("toy", given).kind == "bundled"
    fetch_data_sets(["toy"], host.url)
    assert find_data_set("toy", given).kind == "fetched"
    (given / "toy").mkdir(parents=True)
    assert find_data_set("toy", given).kind == "given"
    assert data_set_folder("toy", given) == given / "toy"


def test_a_set_of_which_a_file_is_missing_was_not_fetched(host, cache, tmp_path):
    fetch_data_sets(["toy"], host.url)
    (cache / "toy" / "a.csv").unlink()
    assert find_data_set("toy", tmp_path) is None


def test_the_folder_beside_the_repository_counts_as_given(tmp_path, monkeypatch):
    work = tmp_path / "repository"
    work.mkdir()
    monkeypatch.chdir(work)
    assert given_folder(None) is None
    (tmp_path / "shared" / "data" / "ur10e").mkdir(parents=True)
    assert given_folder(None) == tmp_path / "shared" / "data"
    assert find_data_set("ur10e").kind == "given"
    assert find_data_set("ur10e", tmp_path) is None  # another folder is given in its place


def test_a_part_may_lie_in_the_folder_of_its_whole(tmp_path):
    folder = tmp_path / "neura_lara8"
    folder.mkdir()
    assert find_data_set("neura_lara8_urdf", tmp_path) is None
    for name in ("robot.urdf", "robot.yaml"):
        (folder / name).touch()
    assert find_data_set("neura_lara8_urdf", tmp_path).folder == folder


def test_the_repository_holds_three_sets(tmp_path):
    for name in ("panda_ati_gamma", "link_contact", "neura_lara8"):
        assert find_data_set(name, tmp_path).kind == "bundled"


def test_a_missing_set_is_reported_with_the_command_that_gets_it(tmp_path):
    with pytest.raises(InputError, match=r"^ur10e: .* not there; `wrenchsight data fetch ur10e`$"):
        data_set_folder("ur10e", tmp_path)
    with pytest.raises(InputError, match=r"^mine: .* not there; mine: give it with --data$"):
        data_set_folder("mine", tmp_path)
    with pytest.raises(InputError, match="no set of recordings is named 'ur11'; known are ur10e"):
        data_set("ur11")


def test_a_recording_is_csv_or_parquet(tmp_path):
    with pytest.raises(InputError, match=r"holds neither log\.csv nor log\.parquet"):
        recording_file(tmp_path, "log")
    (tmp_path / "log.parquet").touch()
    assert recording_file(tmp_path, "log").suffix == ".parquet"
    (tmp_path / "log.csv").touch()
    assert recording_file(tmp_path, "log").suffix == ".csv"


def test_every_set_can_be_had_in_some_way():
    for name, one in DATA_SETS.items():
        assert one.published or one.advice, name
        if one.published:
            assert one.megabytes == pytest.approx(
                sum(file.num_bytes for file in one.published) / 1e6, abs=0.06
            )


def test_one_line_lists_experiments_and_their_missing_sets():
    line = missing_recordings({"one": ("ur10e", "staubli_tx40"), "two": ("ur10e", "ur10e_more")})
    assert line == (
        "missing recordings: ur10e (one, two), staubli_tx40 (one), ur10e_more (two); to get them: "
        "`wrenchsight data fetch ur10e ur10e_more`; "
        f"staubli_tx40: {DATA_SETS['staubli_tx40'].advice}"
    )
    assert how_to_get_all(["mine"]) == "mine: give it with --data"
