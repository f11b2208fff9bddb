"""Two studies: what their reports print differently, and nothing else."""

import json

import pytest

from wrenchsight.analyses.study.compare_studies import differences, main
from wrenchsight.models.files.input_error import InputError

METRICS = {"rmse": 1.23456, "list": [1.0, 2.0], "inner": {"count": 3, "missing": None}}
ROW = {
    "label": "RMSE", "key": "rmse", "unit": "N", "article": 1.2, "remark": "", "source": "article",
}  # fmt: skip


def write(folder, metrics=METRICS, notes=("In 1.5 to 2 s it falls to 1.23 N.",), name="task"):
    (folder / name).mkdir(parents=True)
    (folder / name / "metrics.json").write_text(json.dumps(metrics))
    stored = {"comparison": [ROW], "notes": list(notes)}
    (folder / name / "result.json").write_text(json.dumps(stored))
    return folder


def compared(tmp_path, metrics=METRICS, **options):
    first = write(tmp_path / "first")
    return differences(first, write(tmp_path / "second", metrics, **options))


@pytest.mark.parametrize("rmse", [1.23456, 1.23461, 1.2345600001])
def test_what_is_printed_alike_is_alike(tmp_path, rmse):
    assert compared(tmp_path, METRICS | {"rmse": rmse}) == []


def test_a_figure_and_its_row_are_listed(tmp_path):
    found = compared(tmp_path, METRICS | {"rmse": 1.2378})
    assert [(one.what, one.first, one.second) for one in found] == [
        (".rmse", "1.235", "1.238"),
        ("RMSE", "1.23", "1.24"),
    ]


def test_a_digit_at_its_rounding_edge_counts_as_the_same(tmp_path):
    first = write(tmp_path / "first", METRICS | {"rmse": 1.2345 - 1e-9})
    second = write(tmp_path / "second", METRICS | {"rmse": 1.2345 + 1e-9})
    assert differences(first, second) == []


def test_lists_inner_figures_and_what_one_lacks_are_listed(tmp_path):
    other = {"rmse": 1.23456, "list": [1.0, 2.5], "inner": {"count": 4}}
    found = {one.what: (one.first, one.second) for one in compared(tmp_path, other)}
    assert found == {
        ".list[1]": ("2", "2.500"),
        ".inner.count": ("3", "4"),
        ".inner.missing": ("not finite", "absent"),
    }


def test_a_note_counts_but_not_its_seconds(tmp_path):
    assert compared(tmp_path, notes=("In 17 to 21.5 s it falls to 1.23 N.",)) == []
    (found,) = differences(
        tmp_path / "first",
        write(tmp_path / "third", notes=("In 17 to 21.5 s it falls to 1.24 N.",)),
    )
    assert found.what == "note"
    assert "1.24" in found.second


def test_the_command_says_how_many(tmp_path, capsys):
    first, second = write(tmp_path / "first"), write(tmp_path / "second")
    assert main([str(first), str(second)]) == 0
    assert capsys.readouterr().out == "no difference\n"
    third = write(tmp_path / "third", METRICS | {"rmse": 7.0})
    assert main([str(first), str(third)]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "2 differences"
    assert main([str(first)]) == 2
    assert main([str(first), str(tmp_path)]) == 2
    assert "no experiment in common" in capsys.readouterr().err


def test_a_broken_file_is_named(tmp_path):
    first, second = write(tmp_path / "first"), write(tmp_path / "second")
    (second / "task" / "metrics.json").write_text("{")
    with pytest.raises(InputError, match=r"metrics\.json: cannot be read"):
        differences(first, second)
