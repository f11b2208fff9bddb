"""Campaigns of toy experiments: what they keep, go on with, survive and refuse."""

import json
import signal
import socket
import sys
import time

import pyarrow.parquet as pq
import pytest

from wrenchsight.analyses.campaign.campaign import remaining_seconds, run_campaign
from wrenchsight.analyses.campaign.campaign_store import WorldParts, read_table
from wrenchsight.analyses.campaign.world_run import CampaignSettings, WorldOutcome
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.truth.worlds import draw_world

pytestmark = pytest.mark.long  # studies and campaigns run in processes of their own


def test_one_row_a_world_experiment_and_key(tmp_path, experiment, campaign, counted):
    experiment("toy")
    experiment("other")
    result = campaign("toy", "other")
    assert result.worlds == 3
    assert not result.failures
    # What the experiments of a world have in common is computed once.
    assert counted("identified") == 3
    assert counted("found") == 1  # once for all worlds
    table = pq.read_table(tmp_path / "campaign" / "campaign.parquet")
    world = draw_world(0, 1)
    drawn = list(world.parameters())
    assert table.column_names == ["world", "seed", *drawn, "experiment", "key", "value"]
    types = {name: str(table.schema.field(name).type) for name in table.column_names}
    assert [types.pop(name) for name in ("world", "seed")] == ["int32", "int64"]
    assert [types.pop(name) for name in ("experiment", "key")] == ["string", "string"]
    assert set(types.values()) == {"double"}
    rows = [row for row in table.to_pylist() if row["world"] == 1 and row["experiment"] == "toy"]
    assert {row["seed"] for row in rows} == {world.seed}
    assert {name: rows[0][name] for name in drawn} == world.parameters()
    values = {row["key"]: row["value"] for row in rows}
    assert list(values) == [
        "optimised.rmse_n",
        "ours.rmse_n",
        "ours.nothing",
        "rmse_nm.0",
        "rmse_nm.1",
        "rmse_nm.2",
        "coulomb",
        "arm",
        "path",
    ]
    assert values["ours.nothing"] is None  # not finite
    assert values["coulomb"] == world.factors["coulomb"][0]
    assert values["arm"] == world.seed

    metrics = json.loads((tmp_path / "campaign" / "metrics.json").read_text())
    assert metrics["toy"]["optimised.rmse_n"]["article"] == 1.5
    assert metrics["toy"]["optimised.rmse_n"]["share_of_worlds_ours_ahead"] == 1.0
    assert metrics["toy"]["rmse_nm.2"]["article"] == 0.3
    assert "The toy experiment" in (tmp_path / "campaign" / "campaign.html").read_text()


def test_finished_worlds_are_never_run_again(tmp_path, experiment, campaign, counted):
    experiment("toy")
    experiment("other")
    campaign("toy", worlds=2, jobs=1)
    previous = (tmp_path / "campaign" / "campaign.parquet").read_bytes()
    assert campaign("toy", worlds=2).reused == 2
    assert counted("ran_toy") == 2
    assert (tmp_path / "campaign" / "campaign.parquet").read_bytes() == previous
    assert campaign("toy", worlds=3).worlds == 3
    assert counted("ran_toy") == 3
    campaign("other", worlds=3)
    assert (counted("ran_toy"), counted("ran_other")) == (3, 3)
    # The same bytes as those of a campaign that ran at once, in another order.
    campaign("toy", "other", worlds=3, folder="at_once", jobs=1)
    assert file_of(tmp_path, "campaign") == file_of(tmp_path, "at_once")


def file_of(tmp_path, folder):
    return (tmp_path / folder / "campaign.parquet").read_bytes()


def test_the_fastest_feed_alone_is_another_campaign(tmp_path, experiment, campaign):
    body = "    (FOLDER / 'feeds').write_text(str(context.fastest_feed))"
    experiment("feeds", body)
    campaign("feeds", worlds=1, jobs=1, fastest_feed=True)
    assert (tmp_path / "feeds").read_text() == "True"
    with pytest.raises(InputError, match="of another fastest feed"):
        campaign("feeds", worlds=1, jobs=1)
    campaign("feeds", worlds=1, jobs=1, folder="all")
    assert (tmp_path / "feeds").read_text() == "False"
    with pytest.raises(InputError, match="of another fastest feed"):
        campaign("feeds", worlds=1, jobs=1, folder="all", fastest_feed=True)


def test_compiled_loops_of_a_world_take_one_thread(tmp_path, experiment, campaign):
    """Loops of two worlds that wait for each other's threads took a quarter more of both cores."""
    body = "    import numba\n    (FOLDER / 'threads').write_text(str(numba.get_num_threads()))"
    experiment("threaded", body)
    campaign("threaded", worlds=1, jobs=1)
    assert (tmp_path / "threads").read_text() == "1"  # also where there are more cores


def test_a_failing_world_is_listed_and_runs_alone(tmp_path, experiment, campaign, counted):
    seed = draw_world(0, 1).seed
    body = f"""
    if context.seed == {seed} and not (FOLDER / "repaired").exists():
        raise ValueError("the arm broke\\nin two")
"""
    experiment("toy", body)
    experiment("other")
    result = campaign("toy", "other", jobs=1)
    assert list(result.failures) == [1]
    assert result.failures[1].seed == seed
    assert result.failures[1].failures["toy"].startswith("ValueError: the arm broke\n")
    text = (tmp_path / "campaign" / "failures" / "world-00001.txt").read_text()
    assert f"seed {seed}" in text
    assert "raise ValueError" in text
    assert "the arm broke" in (tmp_path / "campaign" / "campaign.html").read_text()
    assert counted("ran_other") == 3  # the others went on, in that world too

    (tmp_path / "repaired").touch()
    assert not campaign("toy", "other", jobs=1, world=1).failures
    assert (tmp_path / "campaign" / "world-00001" / "toy" / "drawn.txt").is_file()
    assert counted("ran_toy") == 3
    assert not (tmp_path / "campaign" / "failures").exists()
    campaign("toy", "other", jobs=1, folder="never_failed")
    assert file_of(tmp_path, "campaign") == file_of(tmp_path, "never_failed")


def test_a_killed_process_loses_nothing(tmp_path, experiment, campaign):
    seed = draw_world(0, 1).seed
    once = f"""
    if context.seed == {seed} and not (FOLDER / "killed").exists():
        (FOLDER / "killed").touch()
        os.kill(os.getpid(), signal.SIGKILL)
"""
    always = f"""
    if context.seed == {seed}:
        os.kill(os.getpid(), signal.SIGKILL)
"""
    experiment("once", once)
    experiment("always", always)
    result = campaign("once")
    assert (result.worlds, result.failures) == (3, {})
    assert not (tmp_path / "campaign" / ".wrenchsight.partial").exists()
    result = campaign("always", jobs=1, folder="always")
    assert result.worlds == 2
    assert "died (SIGKILL(-9)), each time" in result.failures[1].failures["always"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_an_interrupt_keeps_finished_worlds(tmp_path, experiment, ended, number):
    seed = draw_world(0, 1).seed
    module = experiment("toy", f"    time.sleep(600.0 if context.seed == {seed} else 0.0)")
    out = tmp_path / "campaign"
    program = f"""
    from wrenchsight.analyses.campaign.campaign import run_campaign
    from wrenchsight.analyses.campaign.world_run import CampaignSettings
    run_campaign(CampaignSettings(['toy'], 3, jobs=2), Path({str(out)!r}))
    """
    code, printed = ended(
        module, program, lambda: len(list((out / ".campaign").glob("*.json"))) == 2, number
    )
    assert code != 0
    assert printed.count("Traceback") == 1, printed  # of no worker
    assert "died" not in printed, printed
    table = pq.read_table(out / "campaign.parquet")
    assert sorted(set(table["world"].to_pylist())) == [0, 2]
    assert not list((out / ".campaign").glob("*.json"))


def test_a_fresh_campaign_ended_before_its_first_world_keeps_the_earlier_one(
    tmp_path, experiment, campaign
):
    experiment("toy")
    campaign("toy", worlds=1, jobs=1)
    previous = file_of(tmp_path, "campaign")

    def end(progress):
        if progress.state == "running":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_campaign(CampaignSettings(["toy"], 1, seed=5, fresh=True), tmp_path / "campaign", end)
    assert file_of(tmp_path, "campaign") == previous
    assert (tmp_path / "campaign" / "campaign.html").exists()


@pytest.mark.parametrize(
    ("cause", "state"), [(KeyboardInterrupt(), "interrupted"), (OSError("disk full"), "failed")]
)
def test_the_progress_says_interrupted_only_after_an_interrupt(tmp_path, experiment, cause, state):
    experiment("toy")
    states = []

    def end_after_a_world(progress):
        states.append(progress.state)
        if progress.fraction > 0.0:
            raise cause

    with pytest.raises(type(cause)):
        run_campaign(CampaignSettings(["toy"], 2), tmp_path / "campaign", end_after_a_world)
    assert states[-1] == state
    assert states[:-1] == ["running"] * len(states[:-1])


@pytest.mark.parametrize(
    ("elapsed", "done", "total", "jobs", "remaining"),
    [
        (10.0, 1, 14, 2, 60.0),  # the second world is about to end: 12 in 6 rounds of 10 s
        (10.0, 2, 14, 2, 60.0),
        (20.0, 3, 14, 2, 50.0),
        (10.0, 1, 14, 1, 130.0),
        (10.0, 1, 3, 8, 0.0),  # all run at once
    ],
)
def test_the_time_left_counts_worlds_that_run_side_by_side(
    elapsed, done, total, jobs, remaining
) -> None:
    assert remaining_seconds(elapsed, done, total, jobs) == pytest.approx(remaining)


def test_the_time_left_is_told_after_each_world(tmp_path, experiment, monkeypatch):
    """Of three worlds, two side by side."""
    experiment("toy")
    asked, told = [], []

    def an_hour(elapsed, done, total, jobs):
        asked.append((done, total, jobs))
        return 3600.0

    monkeypatch.setattr("wrenchsight.analyses.campaign.campaign.remaining_seconds", an_hour)
    settings = CampaignSettings(["toy"], 3, jobs=2)
    run_campaign(settings, tmp_path / "campaign", lambda progress: told.append(progress.action))
    assert asked == [(1, 3, 2), (2, 3, 2), (3, 3, 2)]
    assert told[1] == "1 of 3 worlds, 60 min left"


def test_a_kill_keeps_finished_worlds(tmp_path, experiment, campaign, counted):
    experiment("toy")
    campaign("toy", worlds=2)
    # As if killed after its worlds, before the file: what is beside counts.
    record = read_table(tmp_path / "campaign" / "campaign.parquet")
    (tmp_path / "again").mkdir()
    parts = WorldParts(tmp_path / "again")
    for number in record.worlds:
        world = draw_world(0, number)
        values = {"toy": record.figures("toy").loc[number].to_dict()}
        values["toy"]["ours.nothing"] = None
        parts.add(
            WorldOutcome(number, world.seed, world.parameters(), values, record.described), record
        )
    assert campaign("toy", worlds=2, folder="again").reused == 2
    assert counted("ran_toy") == 2
    assert file_of(tmp_path, "again") == file_of(tmp_path, "campaign")
    assert not list((tmp_path / "again").glob(".campaign*"))


def test_another_campaign_s_folder_is_refused(tmp_path, experiment, campaign, counted):
    experiment("toy")
    campaign("toy", worlds=1, jobs=1)
    with pytest.raises(InputError, match=r"holds worlds of another seed.*--fresh"):
        campaign("toy", seed=1)
    with pytest.raises(InputError, match="of another quick"):
        campaign("toy", quick=True)
    module = tmp_path / "modules" / "fake_toy.py"
    module.write_text(module.read_text() + "# changed\n")
    with pytest.raises(InputError, match="of another software of toy"):
        campaign("toy")
    assert campaign("toy", worlds=1, jobs=1, fresh=True).reused == 0
    assert counted("ran_toy") == 2
    (tmp_path / "campaign" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"holds notes.txt"):
        campaign("toy", worlds=1)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["identificatoin"], "did you mean identification?"),
        (["identification", "--world", "5", "--worlds", "3"], "--world: is 5, expected 0 to 2"),
        (["identification", "--cluster", "tcp://127.0.0.1:9"], "no scheduler answers at tcp"),
        (["identification", "--cluster", "tls://127.0.0.1:1"], "no scheduler answers at tls"),
        (["identification", "--cluster", "tcp://nowhere.invalid:1"], "no scheduler answers at"),
        (["identification", "--cluster", "SILENT"], "no scheduler answers at tcp"),
        (["identification", "--cluster", "SECRET"], "no scheduler answers at tls"),
        (["identification", "--cluster", ""], "is no address of a scheduler"),
        (["identification", "--cluster", "garbage"], "is no address of a scheduler"),
        (["identification", "--cluster", "tcp://"], "is no address of a scheduler"),
        (["identification", "--cluster", "inproc://x"], "is no address of a scheduler"),
        (["identification", "--cluster", "tcp://127.0.0.1:99999"], "is no address of a scheduler"),
        (["identification", "--cluster", "x", "--world", "0"], "leave --cluster out"),
    ],
)
def test_a_wrong_option_is_one_line(tmp_path, words, message, capfd, monkeypatch):
    from wrenchsight.analyses.__main__ import main
    from wrenchsight.analyses.campaign import workers

    monkeypatch.setattr(workers, "_CONNECT_TIMEOUT", 1)
    with socket.create_server(("127.0.0.1", 0)) as silent:  # takes connections, and says nothing
        port = silent.getsockname()[1]
        places = {"SILENT": f"tcp://127.0.0.1:{port}", "SECRET": f"tls://127.0.0.1:{port}"}
        begins = "SECRET" in words  # the library alone tells that nobody speaks TLS there
        words = [places.get(word, word) for word in words]
        monkeypatch.setattr(
            sys, "argv", ["wrenchsight", "campaign", *words, "--out", f"{tmp_path}/c"]
        )
        start = time.monotonic()
        with pytest.raises(SystemExit) as ended:
            main()
    assert time.monotonic() - start < 20  # s; the library alone goes on for 43
    assert ended.value.code == 2
    lines = capfd.readouterr().err.splitlines()
    assert message in lines[-1]
    assert len(lines) == 1 or begins
