"""The README's table of results, between its markers."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.study import readme_table
from wrenchsight.analyses.study.experiment import ComparisonRow
from wrenchsight.analyses.study.readme_table import (
    BEGIN,
    END,
    FEWEST_WORLDS,
    RESULTS,
    WORLDS,
    collect,
    committed,
    fill,
    main,
    results_table,
    shown_rows,
    together,
)
from wrenchsight.models.files.input_error import InputError

README = f"# Title\n\n{BEGIN}\nold\n{END}\n\nAfter ü.\n"


@pytest.fixture
def study(tmp_path):
    out = OutputFolder(tmp_path / "study")
    metrics = {
        "combined": {"reduction_rmse_x_pct": 20.5},
        "constant-wrench": {"optimised": {"max_error_y_n": 24.7}, "rmse": [1.0, 2.0]},
        "silent": {},
    }
    out.write_json("metrics.json", metrics)

    pole = ComparisonRow("Pole", "reduction_rmse_x_pct", 20, "a | b", "eq. 30", unit="1/s")
    largest = ComparisonRow("Largest", "optimised.max_error_y_n", 24.86)
    rows = {
        "combined": [pole],
        "constant-wrench": [largest, ComparisonRow("Per axis", "rmse")],
        "silent": [],
    }
    for name, comparison in rows.items():
        OutputFolder(out / name).write_json(
            "result.json",
            {"title": f"The {name}", "comparison": comparison, "quick": False, "seed": 0},
        )
    return out.path


@pytest.fixture
def readme(tmp_path):
    path = tmp_path / "README.md"
    path.write_text(README, encoding="utf-8")
    return path


def test_the_table_has_one_line_a_row_in_the_report_s_order(study):
    assert results_table(collect(study)).splitlines() == [
        "| Experiment | Measure | Article | Here | Why, where they differ |",
        "|---|---|---:|---:|---|",
        "| The constant-wrench | Largest [N] | 24.86 | 24.70 |  |",
        r"| The combined | Pole [1/s] | 20.0 (eq. 30) | 20.5 | a \| b |",
    ]


def test_the_whole_table_has_the_rows_that_the_readme_leaves_out(study):
    results = collect(study)
    extra = "|  | Per axis |  | 1 2 |  |"
    assert extra in results_table(results, whole=True)
    assert extra not in results_table(results)


def test_shortened_runs_are_called_that(study):
    results = collect(study)
    assert "quick" not in results_table(results)
    assert "shortened runs (`--quick`)" in results_table(results | {"quick": True}).splitlines()[0]


def test_the_committed_readme_shows_the_committed_figures():
    root = Path(readme_table.__file__).resolve().parents[2]
    results = json.loads((root / RESULTS).read_text(encoding="utf-8"))
    keys = {
        e["name"]: {row["key"] for row in e["rows"] if row["readme"]}
        for e in results["experiments"]
    }
    assert {n: k for n, k in keys.items() if k} == {n: set(k) for n, k in shown_rows().items()}
    assert not results["quick"]
    shown = (root / "README.md").read_text(encoding="utf-8").split(BEGIN)[1].split(END)[0]
    worlds = committed(root / "README.md", WORLDS)
    assert shown == "\n" + results_table(results, worlds), "run `make readme` after `make study`"


def test_the_figures_stand_beside_the_readme_and_between_its_markers(study, readme):
    readme.chmod(0o664)
    assert main([str(study), str(readme)]) == 0
    written = json.loads((readme.parent / RESULTS).read_text(encoding="utf-8"))
    assert written == collect(study)
    table = results_table(written)
    assert readme.read_text(encoding="utf-8") == README.replace("old\n", table)
    assert readme.stat().st_mode & 0o777 == 0o664
    before = readme.stat().st_mtime_ns
    assert not fill(readme, table)  # filled already
    assert readme.stat().st_mtime_ns == before


@pytest.mark.parametrize(
    "text", ["none", BEGIN, END, f"{END}\n{BEGIN}", f"{BEGIN}{END}{BEGIN}{END}"]
)
def test_wrong_markers_are_named_and_the_file_stays(study, readme, text):
    readme.write_text(text)
    with pytest.raises(InputError, match="results: begin"):
        fill(readme, results_table(collect(study)))
    assert readme.read_text() == text


@pytest.mark.parametrize("content", [None, "{", "{}"])
def test_a_folder_without_results_is_named(tmp_path, content, capsys):
    if content is not None:
        (tmp_path / "metrics.json").write_text(content)
    assert main([str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "metrics.json" in error


def test_it_runs_as_a_module(study, readme):
    module = ("-m", "wrenchsight.analyses.study.readme_table")
    command = [sys.executable, *module, study, readme]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "filled" in result.stdout
    assert "24.86" in readme.read_text(encoding="utf-8")


MOVED_BY = [
    {"parameter": "load", "rank_correlation": -0.7},
    {"parameter": "wander", "rank_correlation": 0.4},
]


@pytest.fixture
def campaign(tmp_path):
    def spread(median, ahead=None):
        figures = {"median": median, "p05": median - 1.0, "p95": median + 1.0, "worlds": 200}
        return figures | {"share_of_worlds_ours_ahead": ahead}

    metrics = {
        "campaign": {"quick": False, "worlds": 200, "seed": 0},
        "combined": {"reduction_rmse_x_pct": spread(7.5, 0.99) | {"moved_by": MOVED_BY}},
        "constant-wrench": {"rmse.0": spread(2.0), "rmse.1": spread(3.0)},
    }
    folder = OutputFolder(tmp_path / "campaign")
    folder.write_json("metrics.json", metrics)
    return folder.path, metrics


def test_the_readme_says_the_median_and_the_range_of_worlds(study, readme, campaign):
    results, (_, worlds) = collect(study), campaign
    for experiment in results["experiments"]:
        for row in experiment["rows"]:
            row["readme"] = True
    text = results_table(results, worlds)
    assert "| Pole [1/s] | 20.0 (eq. 30) | 7.50 (6.50 to 8.50) | ours ahead in 99 %; " in text
    assert "*Correlates with* names the drawn parameters" in text
    assert "; correlates with load (−), wander (+); a" in text
    assert "median of 200 worlds" in text.splitlines()[-1]
    assert "by `wrenchsight campaign EXPERIMENT --worlds NUMBER`" in text.splitlines()[-1]
    table = results_table(results, worlds, whole=True)  # the documentation's has the one run's too
    assert "| Median of 200 worlds (5 to 95 %) |" in table
    assert "| 20.5 | 7.50 (6.50 to 8.50), ours ahead in 99 % | correlates with load (−)" in table
    assert "| 2.00 (1.00 to 3.00), 3.00 (2.00 to 4.00) |" in table
    first = worlds | {"constant-wrench": {"rmse.0": worlds["constant-wrench"]["rmse.0"]}}
    assert "| 2.00 (1.00 to 3.00), – |" in results_table(results, first, whole=True)
    assert "| 2.00 (1.00 to 3.00), 2 |" in results_table(results, first)  # that of the one run
    few = json.loads(json.dumps(worlds))
    few["campaign"]["worlds"] = FEWEST_WORLDS - 1
    for name in ("combined", "constant-wrench"):
        for figure in few[name].values():
            figure["worlds"] = FEWEST_WORLDS - 1
    assert results_table(results, few) == results_table(results)  # no range of so few
    assert "| Median of 19 worlds" in results_table(results, few, whole=True)
    other = worlds | {"campaign": worlds["campaign"] | {"quick": True}}
    assert results_table(results, other) == results_table(results)
    assert results_table(results, other, whole=True) == results_table(results, whole=True)


def test_campaigns_in_a_folder_each_make_one_table(study, readme, campaign, tmp_path, capsys):
    folder, worlds = campaign
    other = json.loads(json.dumps(worlds))
    other["campaign"]["worlds"] = 20
    del other["combined"], worlds["constant-wrench"]
    for figure in other["constant-wrench"].values():
        figure["worlds"] = 20
    OutputFolder(tmp_path / "machining").write_json("metrics.json", other)
    OutputFolder(folder).write_json("metrics.json", worlds)
    folders = [tmp_path / "machining", folder]
    expected = {**worlds, "constant-wrench": other["constant-wrench"]}
    assert together(folders) == expected == together(folders[::-1])
    assert main([str(study), str(readme), *map(str, folders)]) == 0
    assert json.loads((readme.parent / WORLDS).read_text(encoding="utf-8")) == expected
    text = readme.read_text(encoding="utf-8")
    assert "median of 200 worlds (20 of `constant-wrench`) and" in text
    assert results_table(collect(study), expected) in text
    for figure in other["constant-wrench"].values():
        figure["worlds"] = 6  # no range is shown of so few, so nothing is said of them
    too_few = {**worlds, "constant-wrench": other["constant-wrench"]}
    assert "median of 200 worlds and" in results_table(collect(study), too_few)
    assert "(6 of `constant-wrench`)" in results_table(collect(study), too_few, whole=True)
    for figure in other["constant-wrench"].values():
        figure["worlds"] = 20
    late_experiments = ["constant-wrench", "surface-path"]  # whose names a file has sorted
    other["surface-path"] = other["constant-wrench"]
    fewer = [
        {**worlds, **{n: other[n] for n in names}}
        for names in (late_experiments, late_experiments[::-1])
    ]
    first, again = (results_table(collect(study), one) for one in fewer)
    assert "(20 of `constant-wrench`, `surface-path`)" in first
    assert first == again
    del other["surface-path"]
    assert main([str(study), str(readme), str(folder), str(folder)]) == 2
    assert "has worlds of combined, as an earlier" in capsys.readouterr().err
    other["campaign"]["quick"] = True
    OutputFolder(tmp_path / "machining").write_json("metrics.json", other)
    assert main([str(study), str(readme), *map(str, folders)]) == 2
    assert "of another length" in capsys.readouterr().err
    assert readme.read_text(encoding="utf-8") == text


def test_a_campaign_is_kept_until_another_one_is_there(study, readme, campaign):
    folder, worlds = campaign
    assert main([str(study), str(readme)]) == 0  # it lies beside the study
    assert json.loads((readme.parent / WORLDS).read_text(encoding="utf-8")) == worlds
    text = readme.read_text(encoding="utf-8")
    (folder / "metrics.json").unlink()
    assert main([str(study), str(readme)]) == 0
    assert readme.read_text(encoding="utf-8") == text
    assert results_table(collect(study), worlds) in text


def test_a_campaign_alone_changes_no_figure_of_the_study(study, readme, campaign, capsys):
    folder, worlds = campaign
    (folder / "metrics.json").rename(folder / "kept.json")
    assert main([str(study), str(readme)]) == 0
    assert "7.50 (6.50 to 8.50)" not in readme.read_text(encoding="utf-8")
    (folder / "kept.json").rename(folder / "metrics.json")
    before = (readme.parent / RESULTS).read_bytes()
    (study / "metrics.json").unlink()
    assert main(["--campaign", str(readme), str(folder)]) == 0
    assert (readme.parent / RESULTS).read_bytes() == before
    assert json.loads((readme.parent / WORLDS).read_text(encoding="utf-8")) == worlds
    assert "7.50 (6.50 to 8.50)" in readme.read_text(encoding="utf-8")
    assert main(["--campaign", str(readme), "nowhere"]) == 2
    assert "run `wrenchsight campaign` first" in capsys.readouterr().err


def test_campaigns_alone_ask_for_a_folder(capsys):
    assert main(["--campaign", "README.md"]) == 2
    assert "CAMPAIGN_FOLDER" in capsys.readouterr().err


def test_an_experiment_s_page_gets_its_tables_and_their_metrics(study, readme, capsys):
    table = {"name": "first", "title": "First", "heads": ["", "ours"], "remarks": ["A remark."]}
    stored = json.loads((study / "combined" / "result.json").read_text(encoding="utf-8"))
    stored["tables"] = [table | {"rows": [["error | N", "1.0 (0.5 to 2.0)"]]}]
    OutputFolder(study / "combined").write_json("result.json", stored)
    assert main([str(study), str(readme)]) == 0  # without a page there is nothing to fill
    page = readme.parent / "docs" / "combined.md"
    page.write_text("# Page\n\n<!-- table first: begin -->\n<!-- table first: end -->\n\nRest.\n")
    assert main([str(study), str(readme)]) == 0
    assert page.read_text() == (
        "# Page\n\n<!-- table first: begin -->\n|  | ours |\n|---|---:|\n"
        "| error \\| N | 1.0 (0.5 to 2.0) |\n\nA remark.\n<!-- table first: end -->\n\nRest.\n"
    )
    page_metrics = json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))
    assert page_metrics["metrics"] == {"reduction_rmse_x_pct": 20.5}
    assert page_metrics["tables"] == stored["tables"]
    page.write_text("no place")
    assert main([str(study), str(readme)]) == 2
    assert "table first: begin" in capsys.readouterr().err
