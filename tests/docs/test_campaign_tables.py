"""The tables of campaigns in docs/worlds.md: of the worlds that are committed, cell by cell."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.analyses.campaign.campaign_store import (
    TABLE_FILE,
    CampaignRecord,
    read_table,
    write_table,
)
from wrenchsight.analyses.campaign.world_run import WorldOutcome
from wrenchsight.analyses.study.readme_table import TABLE_BEGIN, TABLE_END
from wrenchsight.models.truth.worlds import bundled_worlds, draw_world

ROOT = Path(__file__).parents[2]
COMMITTED = {"arm": 200, "machining": 20}  # worlds at the least


@pytest.fixture(scope="module")
def loaded():
    file = ROOT / "docs" / "campaign_tables.py"
    spec = importlib.util.spec_from_file_location("campaign_tables", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def tables(loaded, tmp_path, monkeypatch):
    """The module, with a page of its own that has no worlds yet."""
    monkeypatch.setattr(loaded, "DOCS", tmp_path)
    monkeypatch.setattr(loaded, "PAGE", tmp_path / "worlds.md")
    text = "# Worlds\n"
    for name in loaded.TABLES:
        begin, end = TABLE_BEGIN.format(name), TABLE_END.format(name)
        text += f"\n{begin}\nold\n{end}\n\nAfter {name}.\n"
    loaded.PAGE.write_text(text, encoding="utf-8")
    return loaded


def record_of(experiments, figures, rows=()):
    """A campaign of worlds with these figures by key, a number a world, alike in experiments."""
    described = {
        name: {"world": 0, "comparison": rows if name == "friction" else ()} for name in experiments
    }
    record = CampaignRecord(settings={}, described=described)
    for world in range(len(next(iter(figures.values())))):
        values = {key: each[world] for key, each in figures.items()}
        outcome = WorldOutcome(world, 10 + world, {"coulomb": 1.0 + world})
        outcome.values = {name: dict(values) for name in experiments}
        record.add(outcome)
    return record


def row_of(label, key, article, ours="", unit="N"):
    """A row of "article / here", as a campaign stores it."""
    row = {"label": label, "key": key, "article": article, "ours": ours, "unit": unit}
    return row | {"source": "article", "more_is_better": False, "remark": ""}


def cells(table, label):
    """The cells of the row with this label, without its label and key."""
    (line,) = [line for line in table.splitlines() if line.startswith(f"| {label} |")]
    return [cell.strip() for cell in line.strip("|").split("|")][2:]


def machining(figures):
    return record_of(("polishing", "grinding"), figures)


def kept_in(folder, record):
    folder.mkdir()
    write_table(record, folder / TABLE_FILE, [])
    return str(folder)


def test_a_cell_is_the_median_and_the_range_over_worlds(tables):
    rmse = np.linspace(1.0, 3.0, 21)
    table = tables.machining_table(
        machining({"ours.rmse_n.1": rmse, "article.rmse_n.1": rmse + 0.5})
    )
    assert cells(table, "RMSE, ours [N]") == 2 * ["none", "2.0 (1.1 to 2.9)", "none"]
    assert cells(table, "ours ahead in") == 2 * ["0 of 0", "21 of 21", "0 of 0"]


def test_worlds_with_few_readings_inside_are_named_with_their_share(tables):
    share = [0.99, 0.849, 0.95, 0.3, 0.85]
    table = tables.machining_table(machining({"band_of_valid_without_sensor.turns.2": share}))
    label = "Inside the band, valid readings, no sensor: turns [%]"
    assert cells(table, label)[2] == "85 (41 to 98); 85 in world 1, 30 in world 3"


def test_a_world_without_a_valid_reading_does_not_count(tables):
    figures = {
        "T15.valid_share.estimate.turns": [0.5, 0.0],
        "band_of_valid_without_sensor.turns.0": [1.0, None],
    }
    table = tables.machining_table(machining(figures))
    label = "Inside the band, valid readings, no sensor: turns [%]"
    assert cells(table, label)[0] == "100 (100 to 100)"
    assert cells(table, "Valid, no sensor: turns [%]")[0] == "25 (2 to 48)"


def test_figures_of_the_article_are_told_with_their_range_and_those_outside_named(tables):
    rows = [
        row_of("RMSE in Z", "coulomb_viscous.rmse_z_n", 2.0, ours="ours.rmse_z_n"),
        row_of("largest error in Z", "max_error_z_n", 9.0),
        row_of("reduction of the RMSE in Z", "reduction_rmse_z_pct", 30.0, unit="%"),
        row_of("similarity", "similarity_pct", 90.0, unit="%"),  # printed without a definition
    ]
    figures = {
        "coulomb_viscous.rmse_z_n": [1.0, 2.0, 3.0],
        "ours.rmse_z_n": [0.5, 0.5, 3.5],
        "max_error_z_n": [4.0, 5.0, 6.0],
        "reduction_rmse_z_pct": [20.0, 30.0, 40.0],
        "similarity_pct": [99.0, 99.0, 99.0],
    }
    text = tables.arm_table(record_of(tables.ARM, figures, rows))
    assert text.startswith("3 worlds were drawn")
    assert "| `friction`, Z [%] | 30 | 30.0 (21.0 to 39.0) |" in text
    assert "Of the article's 3 printed figures, 2 lie within" in text
    assert "| `friction`: Largest error in Z [N] | 9 | 5.00 (4.10 to 5.90) |" in text
    assert "imilarity" not in text
    assert "each in at least 2 of the 3 worlds" in text


def test_only_the_tables_of_the_page_change(tables, tmp_path):
    rmse = {"ours.rmse_n.0": [1.0, 2.0], "article.rmse_n.0": [1.0, 3.0]}
    arm = row_of("RMSE in Z", "rmse_z_n", 2.0, ours="ours.rmse_z_n")
    of_arm = record_of(tables.ARM, {"rmse_z_n": [2.0, 2.0], "ours.rmse_z_n": [1.0, 1.0]}, [arm])
    before = tables.PAGE.read_text(encoding="utf-8")
    assert tables.main([]) == 2  # no worlds yet
    assert tables.main([str(tmp_path / "none")]) == 2
    assert tables.PAGE.read_text(encoding="utf-8") == before
    folders = [kept_in(tmp_path / "a", machining(rmse)), kept_in(tmp_path / "b", of_arm)]
    assert tables.main(folders) == 0
    text = tables.PAGE.read_text(encoding="utf-8")
    assert text.startswith("# Worlds\n\n<!-- table arm: begin -->\n2 worlds were drawn")
    assert text.endswith("<!-- table machining: end -->\n\nAfter machining.\n")
    assert "old" not in text
    assert "1.5 (1.1 to 1.9)" in text
    assert "1 of 2" in text
    assert "each in all worlds" in text
    assert tables.main([]) == 0  # anew, from the worlds that were kept
    assert tables.PAGE.read_text(encoding="utf-8") == text


def test_a_campaign_of_other_experiments_is_one_line_and_changes_nothing(tables, tmp_path, capsys):
    good = kept_in(
        tmp_path / "good", machining({"ours.rmse_n.0": [1.0], "article.rmse_n.0": [2.0]})
    )
    part = kept_in(tmp_path / "part", record_of(["friction"], {"rmse_z_n": [1.0]}))
    before = tables.PAGE.read_text(encoding="utf-8")
    assert tables.main([good, part]) == 2
    line = capsys.readouterr().err
    assert "expected a campaign in which every world has identification friction" in line
    assert line.count("\n") == 1
    assert not tables.committed("machining").exists()
    assert tables.PAGE.read_text(encoding="utf-8") == before


@pytest.mark.parametrize("name", COMMITTED)
def test_a_committed_table_is_of_the_committed_worlds(loaded, name):
    record = read_table(loaded.committed(name))
    assert record is not None
    assert len(record.worlds) >= COMMITTED[name]
    page = (ROOT / "docs" / "worlds.md").read_text(encoding="utf-8")
    _, table = loaded.TABLES[name]
    shown = page.partition(TABLE_BEGIN.format(name))[2].partition(TABLE_END.format(name))[0]
    assert shown.strip() == table(record)
    assert loaded.table_of(record, ROOT) == name


def machining_figures(loaded, task, key):
    """This figure of a task in each of the committed worlds, over its feeds: (worlds, feeds)."""
    record = read_table(loaded.committed("machining"))
    assert record is not None
    feeds = enumerate(loaded.FEED_TIMES)
    keys = [key.format(k=k, feed=loaded.feed_key(feed)) for k, feed in feeds]
    return record.figures(task)[keys].to_numpy()  # nan where a world has none


def medians(figures):
    return [f"{median:.0f}" for median in np.median(figures, axis=0)]


def spread(figures):
    low, high = np.percentile(figures, [5, 95])
    return f"{low:.0f} to {high:.0f}"


def test_the_readme_says_of_machining_what_the_committed_worlds_have(loaded):
    """Of readings that count, in either loop, the worst world; of the touch, at 15 s one way."""
    inside = np.stack(
        [
            machining_figures(loaded, "grinding", f"band_of_valid{loop}.steady.{{k}}")
            for loop in ("", "_without_sensor")
        ]
    )
    least = inside.min(axis=(0, 2))  # of each world
    above = machining_figures(loaded, "grinding", "{feed}.regulation.estimate.overshoot_n")[:, 0]
    limits = (ROOT / "README.md").read_text(encoding="utf-8").partition("## Limits")[2]
    assert (
        f"In {np.sum(least >= 0.85)} of {len(least)} simulated arms the band of grinding holds at "
        f"least 85 % of the valid readings of a steady feed, in the worst one {least.min():.0%}. "
    ).replace("%.", " %.") in limits
    assert (
        f"the force at the touch rises by {np.median(above):.0f} N ({spread(above)}) above its "
        "set-point."
    ) in limits


def test_the_page_says_of_the_touch_what_the_committed_worlds_have(loaded):
    """Line by line as the page is wrapped, so without its line breaks."""
    page = " ".join((ROOT / "docs" / "worlds.md").read_text(encoding="utf-8").split())
    key = "{feed}.regulation.estimate."
    grinding, polishing = (
        machining_figures(loaded, task, f"{key}overshoot_n")[:, 0]
        for task in ("grinding", "polishing")
    )
    fast, middle, slow = medians(machining_figures(loaded, "grinding", f"{key}max_error_n"))
    least = machining_figures(loaded, "polishing", f"{key}least_n")
    first, second, third = medians(least)
    assert (
        f"rises above its set-point, by {np.median(grinding):.0f} N in the median world "
        f"({spread(grinding)})."
    ) in page
    assert f"the largest error is {fast}, {middle} and {slow} N at 15, 30 and 60 s." in page
    assert (
        f"The force then rises by {np.median(polishing):.0f} N above its 40 N and falls to "
        f"{first}, {second} and {third} N ({spread(least[:, 0])})."
    ) in page


@pytest.mark.parametrize("name", COMMITTED)
def test_the_committed_worlds_are_those_that_a_campaign_draws(loaded, name):
    """So the README's ranges are what its command prints again."""
    record, source = read_table(loaded.committed(name)), bundled_worlds()
    for number, kept in record.draws().iterrows():
        world = draw_world(0, number, source)
        assert kept.to_dict() == {"seed": world.seed, **world.parameters()}
