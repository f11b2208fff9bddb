"""The report: rendered, then parsed as a browser would."""

from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

from wrenchsight.analyses.output.figures import new_figure
from wrenchsight.analyses.output.outputs import OutputFolder, plain
from wrenchsight.analyses.study.experiment import ComparisonRow, ResultTable
from wrenchsight.analyses.study.outcome import Outcome, StudySettings, look_up
from wrenchsight.analyses.study.own_methods import MethodEntry
from wrenchsight.analyses.study.report import comparisons, number, write_report
from wrenchsight.analyses.study.stored_result import filled_table

METRICS = {
    "initial": {"max_error_y_n": 24.71234, "max_jcn": None},
    "validation": {"14harm50sec": {"rmse_nm": [1.9, 3.0, 1.3, 0.4, 0.4, 0.3]}},
    "log.v2": {"count": 12345},
    "not_finite": ["initial.max_jcn"],
}
TORQUE_RMSE = (1.97, 3.11, 1.3, 0.44, 0.4, 0.34)
ROWS = plain(
    [
        ComparisonRow(
            "Largest error in Y", "initial.max_error_y_n", 24.86, "another draw of <noise>"
        ),
        ComparisonRow(
            "Torque error", "validation.14harm50sec.rmse_nm", TORQUE_RMSE, source="figaroh"
        ),
        ComparisonRow("Samples", "log.v2.count"),
    ]
)

_VOID = {"meta", "img", "br", "link"}


class _Page(HTMLParser):
    """Collects what the tests ask for and checks that the elements nest."""

    def __init__(self, text):
        super().__init__()
        self.links, self.images, self.ids, self.captions, self.open = [], [], [], [], []
        self.text = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        if "id" in attributes:
            self.ids.append(attributes["id"])
        if tag == "a":
            self.links.append(attributes["href"])
        if tag == "img":
            self.images.append(attributes)
        if tag not in _VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.text += data
        if "figcaption" in self.open:
            self.captions.append(data)


@pytest.fixture
def outcome(tmp_path):
    """Returns a function that makes an experiment's folder and its outcome."""

    def make(name, **changes):
        folder = OutputFolder(tmp_path / name)
        for figure_name in ("torque fit", "bode"):
            figure, _ = new_figure(height=2.0)
            folder.write_figure(figure_name, figure)
        folder.write_text("arm.html", "<html></html>")
        folder.write_text("config.yaml", "experiment: <b>one</b>\n")
        folder.write_json("metrics.json", METRICS)
        stored = {
            "title": f"Title of {name}",
            "section": "4.3",
            "notes": ["Reads `fx_n` & says so.", "A second sentence."],
            "figures": [
                {"path": "figures/torque fit.png", "caption": "Torque, measured & predicted."},
                {"path": "figures/bode.png", "caption": "Bode."},
            ],
            "pages": [{"path": "arm.html", "caption": "The arm <moving>"}],
            "comparison": ROWS,
        }
        stored |= changes.pop("stored", {})
        return Outcome(name, "done", seconds=12.3, metrics=METRICS, stored=stored)

    return make


@pytest.fixture
def render(tmp_path):
    def render(*outcomes, **settings):
        folder = OutputFolder(tmp_path)
        for name in ("metrics.json", "timings.json"):
            folder.write_json(name, {})
        both = ("one", "two")
        study_settings = StudySettings(
            both, both, Path("data"), seed=5, quick=False, version="0.1.0"
        )
        path = write_report(folder, outcomes, replace(study_settings, **settings))
        return _Page(path.read_text(encoding="utf-8"))

    return render


def test_every_link_leads_somewhere_and_none_to_the_network(outcome, render, tmp_path):
    failed = Outcome("two", "failed", reason="ValueError: x")
    (tmp_path / "failures").mkdir()
    (tmp_path / "failures" / "two.txt").touch()
    page = render(outcome("one"), failed)
    targets = page.links + [image["src"] for image in page.images]
    assert len(targets) > 8
    for target in targets:
        assert "//" not in target
        if target.startswith("#"):
            assert target[1:] in page.ids
        else:
            assert (tmp_path / unquote(target)).is_file(), target


def test_two_sections_share_a_page_that_loads_nothing(outcome, render, tmp_path):
    page = render(outcome("one"), outcome("two"))
    assert len(set(page.ids)) == len(page.ids)
    captions = "".join(page.captions)
    for number_of_figure in range(1, 5):
        assert captions.count(f"Figure {number_of_figure}.") == 1
    texts = ["Torque, measured & predicted.", "Bode."]
    assert texts[0] in captions
    assert [image["alt"] for image in page.images][:2] == texts
    for image in page.images:
        assert int(image["width"]) == 960
        assert int(image["height"]) == pytest.approx(240, abs=1)  # 2 of 8 inches
    text = (tmp_path / "report.html").read_text()
    for word in ("http:", "https:", "<script", "@import", "url("):
        assert word not in text


def test_the_summary_comes_first_and_compares(outcome, render):
    page = render(outcome("one"))
    summary, section = page.text.split("1\u2002Title of one")  # the section's heading
    for text in ("24.86", "24.71", "another draw of <noise>", "figaroh", "Reads fx_n & says so."):
        assert text in summary
    assert "A second sentence." in section
    assert "A second sentence." not in summary


def test_an_experiment_without_result_is_named_with_the_reason(outcome, render, tmp_path):
    page = render(
        outcome("one"),
        Outcome("bad", "failed", reason="ValueError: <odd>"),
        Outcome("away", "skipped", reason="needs the recordings data/ur10e"),
        Outcome("late", "interrupted"),
        all_experiments=("one", "bad", "away", "late", "unasked"),
    )
    for text in ("ValueError: <odd>", "needs the recordings data/ur10e", "not run: unasked"):
        assert text in page.text
    assert "1 failed, 1 skipped, 1 interrupted" in page.text
    assert "1 result," in page.text


def test_a_study_without_any_result_still_reports(render):
    page = render(Outcome("away", "skipped", reason="needs data; `wrenchsight data fetch ur10e`"))
    assert "0 results, 1 skipped" in page.text
    assert "needs data; wrenchsight data fetch ur10e" in page.text  # marked as code, no backticks


def test_a_source_that_all_share_is_named_once(outcome, render):
    shared = {"comparison": [row | {"source": "figaroh"} for row in ROWS]}
    text = render(outcome("one", stored=shared)).text
    assert text.count("compared with: figaroh") == 1
    assert text.lower().count("figaroh") == 2  # and as the head of the section's own column
    mixed = render(outcome("one")).text
    assert "compared with" not in mixed
    assert mixed.count("figaroh") == 2  # below its figure, in both tables


def test_a_shortened_study_and_an_earlier_result_say_so(outcome, render):
    earlier = outcome("one")
    earlier.state = "earlier"
    page = render(earlier, quick=True)
    assert "shortened" in page.text
    assert "result of an earlier run" in page.text
    assert "wrenchsight study --seed 5 --quick" in page.text


def test_the_command_names_a_subset(outcome, render):
    assert "wrenchsight study one --seed 5" in render(outcome("one"), requested=("one",)).text


def test_text_of_experiments_is_escaped(outcome, render, tmp_path):
    page = render(outcome("one", stored={"notes": ["<script>alert(1)</script> `<b>`"]}))
    assert "<script>alert(1)</script> <b>" in page.text
    assert "experiment: <b>one</b>" in page.text


def test_metrics_are_all_listed(outcome, render):
    text = render(outcome("one")).text
    for key in ("initial.max_error_y_n", "validation.14harm50sec.rmse_nm", "log.v2.count"):
        assert key in text
    assert "All metrics (4)" in text  # not the note "not_finite"


def test_an_experiment_without_notes_or_figures_is_shown(outcome, render):
    empty = {"notes": [], "figures": [], "pages": [], "comparison": []}
    text = render(outcome("one", stored=empty)).text
    assert "Title of one" in text
    assert "The article's figures" not in text  # there is none to compare with
    assert "The article's figures" in render(outcome("two")).text


# ---- figures as text ----


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (24.71234, "24.71"),
        (0.0000123456, "1.235·10⁻⁵"),
        (1.3, "1.300"),
        (9999.7, "10\u202f000"),
        (-0.5, "\u22120.5000"),
        (1052.9, "1053"),
        (98765.4, "98\u202f765"),
        (5.3e9, "5.300·10⁹"),
        (500_000, "500\u202f000"),
        (0.0, "0"),
        (None, "not finite"),
        (True, "yes"),
        ("bayesian", "bayesian"),
    ],
)
def test_numbers(value, text):
    assert number(value) == text


def test_comparisons_show_the_stated_decimals_and_signed_percentages():
    first, second, third = comparisons(METRICS, ROWS)
    assert (first.stated, first.measured) == (("24.86",), ("24.71",))
    assert first.difference == "\u22120.6\u00a0%"
    assert second.stated == ("1.97", "3.11", "1.30", "0.44", "0.40", "0.34")
    assert second.measured == ("1.90", "3.00", "1.30", "0.40", "0.40", "0.30")
    assert second.difference == "\u221212\u2009to\u20090\u00a0%"
    assert (third.stated, third.measured, third.difference) == ((), ("12\u202f345",), "")


@pytest.mark.parametrize(
    ("stated", "here", "texts"),
    [
        (7.3, 7.3123, ("7.30", "7.31")),
        (59.5668, 59.56684, ("59.5668", "59.5668")),
        (20, 20.04, ("20.0", "20.0")),
        ([139, 5797, 901], [138.6, 5801.2, 0.04], ("139 5797 901", "139 5801 0.04000")),
        (139, 76.24, ("139.0", "76.2")),
        (10.0, 8.93, ("10.00", "8.93")),
        (24.86, 0.00012, ("24.860", "0.0001200")),
        (0.0, 0.123456, ("0", "0.1235")),
        (0.02, 0.0199, ("0.0200", "0.0199")),
        (-70.63, -70.0, ("\u221270.63", "\u221270.00")),
        (0.5**0.5, 0.70710588, ("0.707107", "0.707106")),
        (1.0, None, ("1.00", "not finite")),
    ],
)
def test_both_columns_have_the_same_decimals(stated, here, texts):
    row = ROWS[0] | {"key": "x", "article": stated}
    result = comparisons({"x": here}, [row])[0]
    assert (" ".join(result.stated), " ".join(result.measured)) == texts


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("validation.14harm50sec.rmse_nm.1", 3.0),
        ("log.v2.count", 12345),
        ("initial.max_jcn", None),
    ],
)
def test_keys_are_paths(key, value):
    assert look_up(METRICS, key) == value


@pytest.mark.parametrize(
    "key", ["initial.max", "initial.max_error_y_n.0", "validation.14harm50sec.rmse_nm.6", "log"]
)
def test_wrong_keys_are_refused(key):
    with pytest.raises(ValueError, match="no metric is at"):
        look_up(METRICS, key)


def test_tables_and_failures_of_an_experiment_are_shown_as_text(outcome, render):
    table = {
        "name": "first",
        "title": "A <table>",
        "heads": ["", "`their_method`"],
        "rows": [["RMSE [N]", "0.60 (0.30 to 0.90)"], ["<b>", "failed"]],
        "remarks": ["Below `it`."],
    }
    page = render(outcome("one", stored={"tables": [table], "failures": ["method x failed: <y>"]}))
    for text in ("A <table>", "their_method", "0.60 (0.30 to 0.90)", "<b>", "method x failed: <y>"):
        assert text in page.text


def test_the_command_to_repeat_names_the_methods_of_its_option(outcome, render):
    methods = (
        MethodEntry("theirs", "a.b", "make"),
        MethodEntry("installed", "c", "make", "package c"),
    )
    text = render(outcome("one"), methods=methods).text
    assert "wrenchsight study --seed 5 --method theirs=a.b:make\n" in text


def test_cells_have_their_figures_in_their_places_and_a_dash_for_none():
    rows = (("RMSE", "<initial.max_error_y_n:.1f>", "<absent.rmse_n:.1f>", "failed"),)
    table = ResultTable("first", "First", ("", "a", "b", "c"), rows, ("Of <log.v2.count:d>.",))
    filled = filled_table(table, METRICS)
    assert filled.rows == [["RMSE", "24.7", "–", "failed"]]
    assert filled.remarks == ["Of 12345."]
