"""The benchmark's tables: a column for each method, a dash, and a failure with its reason."""

import json
from pathlib import Path

from wrenchsight.analyses.experiments.benchmark.page import LABELS, ROWS, comparison, tables
from wrenchsight.analyses.output.outputs import plain
from wrenchsight.analyses.study import readme_table
from wrenchsight.analyses.study.own_methods import BUILT_IN
from wrenchsight.analyses.study.readme_table import TABLE_BEGIN, TABLE_END, page_table
from wrenchsight.analyses.study.stored_result import filled_table

DOCS = Path(readme_table.__file__).resolve().parents[2] / "docs"
METRICS = {
    "wrench": {
        "ours": {"rmse_n": 0.6, "rmse_n_low": 0.3, "rmse_n_high": 0.9, "rmse_n_mean": 0.61},
        "theirs": {"failed": "ValueError: no"},
    }
}


def test_the_labels_are_those_of_the_methods_that_are_reserved():
    assert tuple(LABELS) == BUILT_IN


def test_a_table_has_a_column_a_method_and_says_what_failed_and_what_is_missing():
    page_tables = tables(METRICS, ["theirs", "other"], {"torque": ["ur10e"], "wrench": []})
    by_name = {table.name: filled_table(table, METRICS) for table in page_tables}
    assert set(by_name) == set(ROWS)
    wrench = by_name["wrench"]
    assert list(wrench.heads)[-3:] == ["ours", "`theirs`", "`other`"]
    first = wrench.rows[0]
    assert first[1:] == ["–", "–", "–", "–", "0.60 (0.30 to 0.90)", "failed", "–"]
    assert wrench.rows[-1][5] == "–"  # ours states no band in these
    assert list(wrench.remarks) == ["`theirs` failed: ValueError: no."]
    assert not by_name["torque"].rows
    assert list(by_name["torque"].remarks) == ["Not measured for want of recordings: ur10e."]


def test_ours_and_others_stand_beside_a_plain_method():
    metrics = {"wrench": {"article": {"rmse_n_mean": 0.9}, **METRICS["wrench"]}}
    metrics["wrench"]["good"] = {"rmse_n_mean": 0.5}
    rows = comparison(metrics, ["theirs", "good"])
    assert [(row.key, row.article) for row in rows] == [
        ("wrench.ours.rmse_n_mean", 0.9),
        ("wrench.good.rmse_n_mean", 0.9),
    ]
    assert (rows[0].source, rows[0].unit) == ("eq. 22, measured here", "N")


def test_the_committed_page_shows_the_committed_metrics_and_nothing_else():
    shown = json.loads((DOCS / "benchmark.json").read_text(encoding="utf-8"))
    assert not shown["quick"]
    text = (DOCS / "benchmark.md").read_text(encoding="utf-8")
    made = tables(shown["metrics"], [], {})
    assert {table["name"] for table in shown["tables"]} == set(ROWS)
    for table in made:
        filled = plain(filled_table(table, shown["metrics"]))
        begin, end = (mark.format(table.name) for mark in (TABLE_BEGIN, TABLE_END))
        between = text.split(begin)[1].split(end)[0]
        assert between == "\n" + page_table(filled, False), "run `make readme` after `make study`"
        assert table.rows
