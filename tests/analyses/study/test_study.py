"""The runner, with small experiments of its own: what it writes, keeps, skips and survives."""

import json
import os
import signal
import sys
import time
from importlib import import_module
from pathlib import Path

import pytest
import yaml

from wrenchsight.analyses.data_sets.registry import DATA_SETS
from wrenchsight.analyses.output.progress import Progress
from wrenchsight.analyses.study import study
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.analyses.study.study import check_names, run_study
from wrenchsight.models.files.input_error import InputError

pytestmark = pytest.mark.long  # studies and campaigns run in processes of their own


@pytest.fixture
def run(tmp_path):
    def run(*names, **options):
        return run_study(names, tmp_path / "study", tmp_path / "data", **options)

    return run


def _read(path):
    return json.loads(path.read_text())


# ---- the registry ----


@pytest.mark.parametrize("name", REGISTRY.entries())
def test_every_registered_module_has_its_experiment(name):
    module = import_module(REGISTRY.entries()[name].module)
    experiment = module.EXPERIMENT
    assert experiment.name == name
    assert experiment.title
    assert experiment.section
    # Literals: a list of sets says who reads them without importing this module.
    entry = REGISTRY.entries()[name]
    assert (entry.needs, entry.uses) == (experiment.needs, experiment.uses)
    assert {*experiment.needs, *experiment.uses} <= set(DATA_SETS)
    if "context.data" in Path(module.__file__).read_text():
        assert experiment.needs or experiment.uses


def test_unknown_names_list_the_known_and_the_nearest():
    with pytest.raises(InputError) as caught:
        check_names(["bandwith"])
    line = str(caught.value)
    assert "did you mean bandwidth?" in line
    assert set(line.partition("known are ")[2].split(", ")) == set(REGISTRY.entries())
    assert "known are bandwidth, " in line  # the nearest first


def test_no_names_are_all_and_repetitions_are_one():
    assert check_names([]) == list(REGISTRY.entries())
    assert check_names(["bandwidth", "constant-wrench", "bandwidth"]) == [
        "bandwidth",
        "constant-wrench",
    ]


# ---- what is written ----


def test_a_study_writes_every_file(experiments, run, tmp_path):
    experiments("one")
    result = run("one", seed=7)
    out = tmp_path / "study"
    assert result.report == out / "report.html"
    assert not result.failed
    files = {str(p.relative_to(out)) for p in out.rglob("*") if p.is_file()}
    assert files == {
        ".wrenchsight.json",
        "metrics.json",
        "timings.json",
        "report.html",
        "one/metrics.json",
        "one/config.yaml",
        "one/result.json",
        "one/figures/noise.png",
    }
    metrics = _read(out / "metrics.json")
    assert metrics == {"one": _read(out / "one" / "metrics.json")} == result.metrics
    assert len(metrics["one"]["rmse_nm"]) == 6
    config = yaml.safe_load((out / "one" / "config.yaml").read_text())
    assert config["experiment"] == "one"
    assert (config["seed"], config["quick"]) == (7, False)
    assert config["configuration"] == {"length": 1000}
    assert _read(out / "timings.json")["one"]["seconds"] > 0


def test_the_same_seed_gives_the_same_bytes_whatever_the_jobs(experiments, tmp_path):
    # Sums of 600,000 products: their last digits depend on how many threads share them.
    product = "float(np.sum(np.linalg.svd(np.random.default_rng(0).normal(size=(300, 300)))[1]))"
    for name in ("one", "two", "three"):
        experiments(name, f"return measured(context, product={product})")
    texts = []
    for jobs in (1, 2, 1):
        out = tmp_path / f"study{len(texts)}"
        run_study([], out, tmp_path, seed=3, jobs=jobs)
        texts.append({p.relative_to(out): p.read_bytes() for p in out.rglob("[mcr]*.[jy]*")})
    assert set(map(str, texts[0])) >= {"metrics.json", "one/config.yaml", "two/result.json"}
    assert texts[0] == texts[1] == texts[2]


@pytest.mark.slow
def test_real_experiments_give_the_same_bytes_whatever_the_jobs(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", None)
    monkeypatch.delattr(sys.modules["__main__"], "__file__", raising=False)
    names = ("jcn-map", "linear-path")
    for jobs in (1, 2):
        run_study(names, tmp_path / str(jobs), tmp_path, quick=True, jobs=jobs)
    for name in ("metrics.json", "jcn-map/result.json", "linear-path/result.json"):
        one, two = ((tmp_path / jobs / name).read_bytes() for jobs in ("1", "2"))
        assert one == two, name
    assert set(_read(tmp_path / "1" / "metrics.json")) == set(names)


def test_progress_reports_each_step(experiments, run):
    costs = {"one": 8.0, "two": 300.0, "three": 30.0, "four": 1.0}
    for name, seconds in costs.items():
        experiments(name, seconds=seconds)
    seen: list[Progress] = []
    result = run(watch=seen.append)
    # Short ones begin first, by `seconds`, so that a result soon shows; then the longest.
    assert list(dict.fromkeys(p.name for p in seen)) == ["four", "one", "two", "three"]
    assert [p.state for p in seen[:1] + seen[-1:]] == ["running", "done"]
    assert Progress("one", "running", 0.5, "half way") in seen
    assert [o.name for o in result.outcomes] == ["one", "two", "three", "four"]


def test_jobs_run_side_by_side(experiments, tmp_path):
    """Two that wait for each other can only end if both run at once."""
    for mine, other in (("one", "two"), ("two", "one")):
        experiments(
            mine,
            f"""
            (context.data / "{mine}").touch()
            while not (context.data / "{other}").exists():
                time.sleep(0.01)""",
        )
    result = run_study([], tmp_path / "study", tmp_path, jobs=2)
    assert [o.state for o in result.outcomes] == ["done", "done"]


def test_threads_are_limited_inside_and_only_there(experiments, run, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
    body = f"return measured(context, threads={{n: os.environ[n] for n in {names}}})"
    experiments("one", body)
    threads = run("one", jobs=study.available_cores()).metrics["one"]["threads"]
    assert threads == dict.fromkeys(names, "1")
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "OPENBLAS_NUM_THREADS" not in os.environ


# ---- what is kept of earlier studies ----


def test_results_of_others_stay_if_they_belong_together(experiments, run, tmp_path):
    for name in ("one", "two"):
        experiments(name)
    both = run(seed=1)
    assert list(both.metrics) == ["one", "two"]
    again = run("two", seed=1)
    assert [(o.name, o.state) for o in again.outcomes] == [("one", "earlier"), ("two", "earlier")]
    fresh = run("two", seed=1, fresh=True)
    assert [(o.name, o.state) for o in fresh.outcomes] == [("one", "earlier"), ("two", "done")]
    assert _read(tmp_path / "study" / "metrics.json") == both.metrics
    assert set(_read(tmp_path / "study" / "timings.json")) == {"one", "two"}


def _again(run, **options):
    """Runs `one` again; returns what is said before it starts, and its state at the end."""
    seen: list[Progress] = []
    result = run("one", watch=seen.append, **options)
    return seen[0].action, {o.name: o.state for o in result.outcomes}["one"]


@pytest.mark.parametrize("other", [{"seed": 2}, {"quick": True}, {"truth": "plain"}])
def test_other_options_run_it_again_and_leave_others_out_unharmed(
    experiments, run, tmp_path, other
):
    for name in ("one", "two"):
        experiments(name)
    run()
    before = (tmp_path / "study" / "two" / "metrics.json").read_bytes()
    names, state = _again(run, **other)
    assert names == f"changed since its earlier result: {next(iter(other))}; it runs again"
    assert state == "done"
    assert list(_read(tmp_path / "study" / "metrics.json")) == ["one"]
    assert (tmp_path / "study" / "two" / "metrics.json").read_bytes() == before


@pytest.mark.parametrize("truth", ["own", "plain"])
def test_an_experiment_is_given_the_truth_that_was_asked(experiments, run, truth):
    body = """truth = context.robot("sts_sre4_600").config.simulated_truth
return measured(context, plain=truth.mechanisms is None)"""
    experiments("one", body=body)
    result = run("one", truth=truth)
    assert result.metrics["one"]["plain"] is (truth == "plain")
    assert result.outcomes[0].stored["truth"] == truth
    report = result.report.read_text()
    assert ("plain friction alone" in report) is (truth == "plain")
    assert ("--truth plain" in report) is (truth == "plain")


def test_changed_software_runs_it_again(experiments, run):
    module = experiments("one")
    run("one")
    module.write_text(module.read_text() + "# changed\n")
    assert _again(run) == ("changed since its earlier result: software; it runs again", "done")
    assert _again(run) == ("nothing has changed since its run", "earlier")


def test_changed_recordings_run_it_again_and_only_those_it_reads(experiments, run, tmp_path):
    experiments("one", needs=("ur10e",))
    for name in ("ur10e", "other"):
        (tmp_path / "data" / name / "deep").mkdir(parents=True)
        (tmp_path / "data" / name / "deep" / "log.csv").write_text("1")
    assert run("one").outcomes[0].state == "done"
    (tmp_path / "data" / "other" / "deep" / "log.csv").write_text("2")
    (tmp_path / "data" / "ur10e" / ".hidden").write_text("2")
    assert _again(run)[1] == "earlier"
    (tmp_path / "data" / "ur10e" / "deep" / "log.csv").rename(tmp_path / "data" / "ur10e" / "a.csv")
    assert _again(run) == ("changed since its earlier result: recordings; it runs again", "done")


def test_software_that_changes_while_it_runs_does_not_count(experiments, run):
    experiments("one", "Path(__file__).open('a').write('# edited\\n')")
    run("one")
    assert _again(run)[1] == "done"


@pytest.mark.parametrize("name", ["metrics.json", "result.json", "figures/noise.png"])
def test_a_result_of_which_a_file_was_removed_does_not_count(experiments, run, tmp_path, name):
    for one in ("one", "two"):
        experiments(one)
    whole = run("one").metrics
    (tmp_path / "study" / "one" / name).unlink()
    assert list(run("two").metrics) == ["two"]
    assert run("one").metrics["one"] == whole["one"]


@pytest.mark.parametrize("name", ["one/metrics.json", "one/figures/mine.png", "report.html"])
def test_a_folder_with_the_users_changes_is_refused_and_stays(experiments, run, tmp_path, name):
    experiments("one")
    run("one")
    path = tmp_path / "study" / name
    path.write_text("mine")
    with pytest.raises(InputError, match=rf"holds {name}, which is not as wrenchsight wrote it"):
        run("one", fresh=True)
    assert path.read_text() == "mine"


def test_files_of_an_earlier_run_do_not_mix_with_the_new(experiments, run, tmp_path):
    experiments("one", "(context.out / 'stale.txt').touch()")
    run("one")
    assert (tmp_path / "study" / "one" / "stale.txt").exists()
    experiments("one")
    run("one")
    assert not (tmp_path / "study" / "one" / "stale.txt").exists()


# ---- what goes wrong ----


def test_absent_recordings_skip_with_a_reason(experiments, run, tmp_path):
    experiments("one", needs=("ur10e",))
    experiments("two")
    result = run()
    assert [(o.name, o.state) for o in result.outcomes] == [("one", "skipped"), ("two", "done")]
    assert "`wrenchsight data fetch ur10e`" in result.outcomes[0].reason
    assert result.outcomes[0].lacks == ("ur10e",)
    assert not result.failed


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("raise RuntimeError('solver\\ngave up')", "RuntimeError: solver"),
        ("raise InputError('log.csv', 'line 3', 'is empty')", "log.csv: line 3: is empty"),
        ("sys.exit(3)", "SystemExit: 3"),
        ("os.kill(os.getpid(), 11)", "its process died (SIGSEGV(-11))"),
        ("os._exit(4)", "its process died (EXIT(4))"),
        ("return ExperimentResult(metrics=dict(a=object()))", "a: object has no plain form"),
    ],
)
def test_one_that_fails_is_reported_and_stops_no_other(experiments, run, tmp_path, body, reason):
    experiments("bad", body)
    experiments("good")
    result = run()
    assert [(o.name, o.state) for o in result.outcomes] == [("bad", "failed"), ("good", "done")]
    assert reason in result.outcomes[0].reason
    assert "\n" not in result.outcomes[0].reason
    assert result.failed
    out = tmp_path / "study"
    assert list(_read(out / "metrics.json")) == ["good"]
    assert (out / "failures" / "bad.txt").exists()
    assert not (out / ".wrenchsight.partial").exists()


def test_what_was_printed_is_in_a_file_with_the_stack_until_it_succeeds(experiments, run, tmp_path):
    text = "print('working', flush=True)\nos.write(2, b'from C')\n"
    for end, stack in (("1 / 0", "ZeroDivisionError"), ("os.kill(os.getpid(), 11)", "in run")):
        experiments("bad", text + end)
        run("bad")
        failure = (tmp_path / "study" / "failures" / "bad.txt").read_text()
        assert all(words in failure for words in ("working", "from C", stack))
    experiments("bad")
    run("bad")
    assert not (tmp_path / "study" / "failures").exists()


def test_a_result_that_names_what_it_lacks_fails(experiments, run):
    for name, more in (
        ("figure", "figures=[FigureFile(Path('f.png'), 'x')]"),
        ("metric", "comparison=[ComparisonRow('', 'a.b', 1.0)]"),
    ):
        experiments(name, f"return ExperimentResult(metrics={{}}, {more})")
    result = run()
    assert [o.state for o in result.outcomes] == ["failed", "failed"]
    assert "f.png is not a file" in result.outcomes[0].reason
    assert "'a.b'" in result.outcomes[1].reason


def test_a_failure_leaves_the_earlier_folder_but_not_its_figures_in_the_summary(
    experiments, run, tmp_path
):
    module = experiments("one")
    run("one")
    before = (tmp_path / "study" / "one" / "metrics.json").read_bytes()
    module.write_text(module.read_text().replace("return measured(context)", "raise OSError('x')"))
    result = run("one")
    assert result.outcomes[0].state == "failed"
    assert (tmp_path / "study" / "one" / "metrics.json").read_bytes() == before
    assert _read(tmp_path / "study" / "metrics.json") == {}


def test_a_module_of_another_name_fails(experiments, run):
    module = experiments("two")
    module.write_text(module.read_text() + "EXPERIMENT = replace(EXPERIMENT, name='one')\n")
    assert "not two" in run("two").outcomes[0].reason


# ---- interrupts ----


def test_an_interrupt_leaves_whole_results_only(experiments, tmp_path):
    experiments("quick-one", seconds=1.0)  # short ones begin first, then the longest
    experiments("slow", "(context.out / 'half.txt').write_text('h')\ntime.sleep(60)", seconds=90.0)
    experiments("never", seconds=50.0)

    def interrupt(progress):
        if progress.name == "slow" and progress.state == "running":
            raise KeyboardInterrupt

    out = tmp_path / "study"
    with pytest.raises(KeyboardInterrupt):
        run_study([], out, tmp_path, watch=interrupt)
    assert list(_read(out / "metrics.json")) == ["quick-one"]
    names = sorted(p.name for p in out.iterdir())
    assert names == [
        ".wrenchsight.json", "metrics.json", "quick-one", "report.html", "timings.json",
    ]  # fmt: skip
    assert "interrupted" in (out / "report.html").read_text()


def test_an_interrupted_run_keeps_the_earlier_whole_result(experiments, run, tmp_path):
    experiments("one")
    earlier = run("one").metrics

    def interrupt(progress):
        if progress.action == "half way":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run("one", watch=interrupt, fresh=True)
    assert _read(tmp_path / "study" / "metrics.json") == earlier


_SLOW = "(context.out / 'pid').write_text(f'{os.getpid()}.')\ntime.sleep(60)"
_PROGRAM = """
from wrenchsight.analyses.study.study import run_study
run_study(["slow"], Path({study!r}), Path("."))
"""


@pytest.fixture
def end_slow(tmp_path, ended):
    """Ends a study while its slow experiment runs; what it wrote, and whether that ran on."""

    def end(module, number, **options):
        pid = tmp_path / "study" / ".wrenchsight.partial/work/slow/result/pid"
        pids = []

        def begun():
            if pid.exists() and pid.read_text().endswith("."):
                pids.append(int(pid.read_text()[:-1]))
            return bool(pids)

        program = _PROGRAM.format(study=str(tmp_path / "study"))
        code, errors = ended(module, program, begun, number, **options)
        assert code != 0
        return errors, pids[0]

    return end


def _is_running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_end_ends_the_experiments_too_and_keeps_what_is_finished(
    experiments, run, tmp_path, end_slow, number
):
    experiments("done")
    run("done")
    errors, experiment = end_slow(experiments("slow", _SLOW), number)
    reason = "KeyboardInterrupt" if number == signal.SIGINT else "TerminatedError: SIGTERM"
    # Once, lines of code left out: the experiment's process says nothing.
    ends = [line for line in errors.splitlines() if not line.startswith(" ")]
    assert sum(line.endswith(reason) for line in ends) == 1
    assert not _is_running(experiment)
    names = {path.name for path in (tmp_path / "study").iterdir()}
    assert names == {".wrenchsight.json", "metrics.json", "timings.json", "report.html", "done"}
    assert run("done").outcomes[0].state == "earlier"


def test_after_a_kill_no_experiment_runs_on_and_the_next_study_tidies_up(
    experiments, run, tmp_path, end_slow
):
    module = experiments("slow", _SLOW)
    _, experiment = end_slow(module, signal.SIGKILL, group=False)
    while _is_running(experiment):
        time.sleep(0.02)
    assert (tmp_path / "study" / ".wrenchsight.partial").is_dir()
    module.write_text(module.read_text().replace("time.sleep(60)", ""))
    run("slow")
    assert not (tmp_path / "study" / ".wrenchsight.partial").exists()


# ---- what is refused ----


@pytest.mark.parametrize(
    ("options", "message"),
    [({"jobs": 0}, "--jobs"), ({"truth": "soft"}, "'soft', expected own, plain, hard")],
)
def test_options_that_cannot_be_are_refused(experiments, run, options, message):
    experiments("one")
    with pytest.raises(InputError, match=message):
        run("one", **options)
