"""The runner, with small experiments of its own: what it writes, keeps, skips and survives."""

import json
import os
import signal
import subprocess
import sys
import time
from importlib import import_module, invalidate_caches
from pathlib import Path

import pytest
import yaml

from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.progress import Progress
from wrenchsight.analyses.output.sole_writer import sole_writer
from wrenchsight.analyses.study import study
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.analyses.study.study import check_names, run_study
from wrenchsight.models.files.input_error import InputError

_MODULE = """
from pathlib import Path
import os, sys, time
from dataclasses import replace
import numpy as np
from wrenchsight.analyses.study.experiment import (
    ComparisonRow, Experiment, ExperimentContext, ExperimentResult, FigureFile
)
from wrenchsight.models.files.input_error import InputError

def run(context: ExperimentContext) -> ExperimentResult:
{body}

def measured(context, **more):
    random = np.random.default_rng(context.seed)
    context.progress(0.5, "half way")
    figure = context.out / "figures" / "noise.png"
    figure.parent.mkdir()
    figure.write_bytes(random.bytes(64))
    return ExperimentResult(
        metrics=dict(max_error_n=random.normal(), rmse_nm=random.normal(size=6), **more),
        figures=[FigureFile(Path("figures/noise.png"), "Noise, as <measured> & drawn.")],
        comparison=[ComparisonRow("Largest error", "max_error_n", "N", 24.86, "other noise")],
        notes=["The error is `small`."],
        configuration=dict(length=10 if context.quick else 1000),
    )

EXPERIMENT = Experiment("{name}", "The {name} experiment", "4.3", run, needs={needs},
    seconds={seconds})
"""


@pytest.fixture
def experiments(tmp_path, monkeypatch):
    """Returns a function that puts an experiment with the given body into the registry."""
    folder = tmp_path / "modules"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    # Else each experiment's process would first import the test runner: its main module.
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", None)
    monkeypatch.delattr(sys.modules["__main__"], "__file__", raising=False)
    bundled = [entry.module for entry in REGISTRY.entries().values()]
    for name in list(REGISTRY.entries()):
        REGISTRY.unregister(name)

    def add(name, body="    return measured(context)", needs=(), seconds=30.0):
        module = f"fake_{name.replace('-', '_')}"
        text = _MODULE.format(body=body, name=name, needs=needs, seconds=seconds)
        (folder / f"{module}.py").write_text(text)
        invalidate_caches()
        if name in REGISTRY.entries():
            REGISTRY.unregister(name)
        REGISTRY.register(module)
        return folder / f"{module}.py"

    yield add
    for name in list(REGISTRY.entries()):
        REGISTRY.unregister(name)
    for module in bundled:
        REGISTRY.register(module)


@pytest.fixture
def run(tmp_path):
    def run(*names, **options):
        return run_study(names, tmp_path / "study", tmp_path / "data", **options)

    return run


def _read(path):
    return json.loads(path.read_text())


# ---- the registry ----


def test_the_names_of_the_first_experiments_are_known():
    assert set(REGISTRY.entries()) >= {
        "constant-wrench",
        "bandwidth",
        "ur10e-identification",
        "ur10e-payload",
        "panda-wrench",
    }


def test_listing_names_imports_nothing_heavy():
    program = (
        "import sys; import wrenchsight.analyses.study.study; "
        "heavy = ('pydrake', 'numba', 'torch', 'scipy', 'matplotlib', 'jinja2', 'rich'); "
        "print([name for name in heavy if name in sys.modules])"
    )
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"


@pytest.mark.parametrize("name", REGISTRY.entries())
def test_every_registered_module_has_its_experiment(name):
    experiment = import_module(REGISTRY.entries()[name].module).EXPERIMENT
    assert experiment.name == name
    assert experiment.title
    assert experiment.section


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
        "one/checksums.sha256",
        "one/.wrenchsight.json",
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
        experiments(name, f"    return measured(context, product={product})")
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
    names = ("jcn-map", "metrics-compare")
    for jobs in (1, 2):
        run_study(names, tmp_path / str(jobs), tmp_path, quick=True, jobs=jobs)
    for name in ("metrics.json", "jcn-map/result.json", "metrics-compare/result.json"):
        one, two = ((tmp_path / jobs / name).read_bytes() for jobs in ("1", "2"))
        assert one == two, name
    assert set(_read(tmp_path / "1" / "metrics.json")) == set(names)


def test_the_seed_and_the_length_reach_the_experiment(experiments, run):
    experiments("one")
    first = run("one", seed=1).metrics["one"]
    assert run("one", seed=2).metrics["one"] != first
    result = run("one", seed=1, quick=True)
    assert result.metrics["one"] == first
    assert result.outcomes[0].stored["quick"] is True


def test_progress_reports_each_step(experiments, run):
    experiments("one")
    seen: list[Progress] = []
    run("one", watch=seen.append)
    assert [p.state for p in seen[:1] + seen[-1:]] == ["running", "done"]
    assert Progress("one", "running", 0.5, "half way") in seen


def test_jobs_run_side_by_side(experiments, tmp_path):
    """Two that wait for each other can only end if both run at once."""
    for mine, other in (("one", "two"), ("two", "one")):
        experiments(
            mine,
            f"""
    (context.data / "{mine}").touch()
    while not (context.data / "{other}").exists():
        time.sleep(0.01)
    return measured(context)""",
        )
    result = run_study([], tmp_path / "study", tmp_path, jobs=2)
    assert [o.state for o in result.outcomes] == ["done", "done"]


def test_threads_are_limited_inside_and_only_there(experiments, run, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
    body = f"    return measured(context, threads={{n: os.environ[n] for n in {names}}})"
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


@pytest.mark.parametrize(
    "other", [{"seed": 2}, {"seed": 1, "quick": True}, {"seed": 1, "truth": "plain"}]
)
def test_results_of_another_seed_or_length_are_left_out_but_not_harmed(
    experiments, run, tmp_path, other
):
    for name in ("one", "two"):
        experiments(name)
    run("one", seed=1)
    before = (tmp_path / "study" / "one" / "metrics.json").read_bytes()
    assert list(run("two", **other).metrics) == ["two"]
    assert list(_read(tmp_path / "study" / "metrics.json")) == ["two"]
    assert (tmp_path / "study" / "one" / "metrics.json").read_bytes() == before


def test_what_is_finished_and_unchanged_is_not_run_again(experiments, run):
    experiments("one")
    first = run("one", seed=1)
    seen: list[Progress] = []
    again = run("one", seed=1, watch=seen.append)
    assert [p.state for p in seen] == ["earlier"]
    assert again.metrics == first.metrics


def _why(run, **options):
    """Runs `one` again; returns what is said before it starts, and its state at the end."""
    seen: list[Progress] = []
    result = run("one", watch=seen.append, **options)
    return seen[0].what, {o.name: o.state for o in result.outcomes}["one"]


@pytest.mark.parametrize("truth", ["own", "plain"])
def test_an_experiment_is_given_the_truth_that_was_asked(experiments, run, truth):
    body = """    truth = context.robot("sts_sre4_600").config.simulated_truth
    return measured(context, plain=truth.mechanisms is None)"""
    experiments("one", body=body)
    result = run("one", truth=truth)
    assert result.metrics["one"]["plain"] is (truth == "plain")
    assert result.outcomes[0].stored["truth"] == truth
    said = result.report.read_text()
    assert ("plain friction alone" in said) is (truth == "plain")
    assert ("--truth plain" in said) is (truth == "plain")


def test_an_unknown_truth_is_refused(experiments, run):
    experiments("one")
    with pytest.raises(InputError, match="'soft', expected own, plain, hard"):
        run("one", truth="soft")


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"seed": 2}, "the seed"),
        ({"quick": True}, "the length"),
        ({"truth": "plain"}, "the simulated truth"),
    ],
)
def test_other_options_run_it_again(experiments, run, options, why):
    experiments("one")
    run("one")
    what, state = _why(run, **options)
    assert what.startswith(why)
    assert state == "done"


def test_changed_software_runs_it_again(experiments, run):
    module = experiments("one")
    run("one")
    module.write_text(module.read_text() + "# changed\n")
    what, state = _why(run)
    assert what.startswith("the software has changed")
    assert state == "done"


def test_changed_recordings_run_it_again_and_only_those_it_reads(experiments, run, tmp_path):
    experiments("one", needs=("ur10e",))
    for name in ("ur10e", "other"):
        (tmp_path / "data" / name).mkdir(parents=True)
        (tmp_path / "data" / name / "log.csv").write_text("1")
    run("one")
    (tmp_path / "data" / "other" / "log.csv").write_text("2")
    assert _why(run)[1] == "earlier"
    (tmp_path / "data" / "ur10e" / "log.csv").write_text("2")
    what, state = _why(run)
    assert what.startswith("the recordings have changed")
    assert state == "done"


def test_software_that_changes_while_it_runs_does_not_count(experiments, run):
    body = "    Path(__file__).open('a').write('# edited\\n')\n    return measured(context)"
    experiments("one", body)
    run("one")
    assert _why(run)[1] == "done"


def _truncate(path):
    path.write_bytes(path.read_bytes()[:40])


def _flip(path):
    content = bytearray(path.read_bytes())
    content[-2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize("damage", [_truncate, _flip, Path.unlink])
@pytest.mark.parametrize(
    "name",
    ["metrics.json", "result.json", "config.yaml", "checksums.sha256", "figures/noise.png"],
)
def test_a_damaged_result_is_said_in_a_line_and_run_again(experiments, run, tmp_path, name, damage):
    experiments("one")
    whole = run("one").metrics
    damage(tmp_path / "study" / "one" / name)
    seen: list[Progress] = []
    again = run("one", watch=seen.append)
    assert "damaged" in seen[0].what
    assert "\n" not in seen[0].what
    assert again.outcomes[0].state == "done"
    assert again.metrics == whole


def test_a_file_of_the_user_s_in_the_folder_does_no_harm(experiments, run, tmp_path):
    experiments("one")
    run("one")
    (tmp_path / "study" / "one" / "my notes.txt").write_text("mine")
    assert _why(run)[1] == "earlier"


def test_the_longest_start_first(experiments, run):
    for name, seconds in (("one", 1.0), ("two", 300.0), ("three", 30.0)):
        experiments(name, seconds=seconds)
    seen: list[Progress] = []
    result = run(watch=seen.append)
    assert list(dict.fromkeys(p.name for p in seen)) == ["two", "three", "one"]
    assert [o.name for o in result.outcomes] == ["one", "two", "three"]


@pytest.mark.parametrize("damage", ["metrics.json", "result.json", "figures/noise.png"])
def test_a_damaged_earlier_result_is_left_out(experiments, run, tmp_path, damage):
    for name in ("one", "two"):
        experiments(name)
    run("one")
    path = tmp_path / "study" / "one" / damage
    if path.suffix == ".json":
        path.write_text(path.read_text()[:40])
    else:
        path.unlink()
    assert list(run("two").metrics) == ["two"]


def test_files_of_an_earlier_run_do_not_mix_with_the_new(experiments, run, tmp_path):
    experiments("one")
    run("one")
    (tmp_path / "study" / "one" / "figures" / "stale.png").touch()
    run("one", fresh=True)
    assert [p.name for p in (tmp_path / "study" / "one" / "figures").iterdir()] == ["noise.png"]


# ---- what goes wrong ----


def test_absent_recordings_skip_with_a_reason(experiments, run, tmp_path):
    experiments("one", needs=("ur10e",))
    experiments("two")
    result = run()
    assert [(o.name, o.state) for o in result.outcomes] == [("one", "skipped"), ("two", "done")]
    assert str(tmp_path / "data" / "ur10e") in result.outcomes[0].reason
    assert not result.failed
    (tmp_path / "data" / "ur10e").mkdir(parents=True)
    assert run("one").outcomes[0].state == "done"


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("    raise RuntimeError('solver\\ngave up')", "RuntimeError: solver"),
        ("    raise InputError('log.csv', 'line 3', 'is empty')", "log.csv: line 3: is empty"),
        ("    sys.exit(3)", "SystemExit: 3"),
        ("    os.kill(os.getpid(), 11)", "its process was ended by signal 11"),
        ("    os._exit(4)", "exit code 4"),
        ("    return ExperimentResult(metrics=dict(a=object()))", "a: object has no plain form"),
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
    assert not list(out.glob(".*partial"))


def test_the_traceback_and_what_was_printed_are_in_a_file(experiments, run, tmp_path):
    experiments("bad", "    print('working', flush=True)\n    os.write(2, b'from C')\n    1 / 0")
    run("bad")
    text = (tmp_path / "study" / "failures" / "bad.txt").read_text()
    assert "working" in text
    assert "from C" in text
    assert "Traceback" in text
    assert "ZeroDivisionError" in text


def test_a_crash_leaves_the_python_stack(experiments, run, tmp_path):
    experiments("bad", "    os.kill(os.getpid(), 11)")
    run("bad")
    assert "in run" in (tmp_path / "study" / "failures" / "bad.txt").read_text()


def test_a_result_that_names_what_it_lacks_fails(experiments, run):
    experiments(
        "figure",
        "    return ExperimentResult(metrics={}, figures=[FigureFile(Path('f.png'), 'x')])",
    )
    experiments(
        "metric",
        "    return ExperimentResult(metrics={}, comparison=[ComparisonRow('', 'a.b', '', 1.0)])",
    )
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


def test_a_later_success_removes_the_note_of_failure(experiments, run, tmp_path):
    module = experiments("one", "    raise OSError('x')")
    run("one")
    module.write_text(module.read_text().replace("raise OSError('x')", "return measured(context)"))
    run("one")
    assert not (tmp_path / "study" / "failures" / "one.txt").exists()


def test_a_module_of_another_name_fails(experiments, run):
    module = experiments("two")
    module.write_text(module.read_text() + "EXPERIMENT = replace(EXPERIMENT, name='one')\n")
    assert "not two" in run("two").outcomes[0].reason


# ---- interrupts ----


def test_an_interrupt_leaves_whole_results_only(experiments, tmp_path):
    experiments("quick-one")
    experiments("slow", "    (context.out / 'half.txt').write_text('h')\n    time.sleep(60)")
    experiments("never")

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
        if progress.what == "half way":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run("one", watch=interrupt, fresh=True)
    assert _read(tmp_path / "study" / "metrics.json") == earlier


def _start(tmp_path, module_folder):
    program = f"""
import signal, sys
from pathlib import Path
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background ignores it
sys.path.insert(0, {str(module_folder)!r})
if __name__ == "__main__":
    from wrenchsight.analyses.study import registry, study
    registry.REGISTRY.register("fake_slow")
    study.run_study(["slow"], Path({str(tmp_path / "study")!r}), Path("."))
"""
    script = tmp_path / "script.py"
    script.write_text(program)
    environment = os.environ | {"PYTHONPATH": str(Path(study.__file__).resolve().parents[2])}
    process = subprocess.Popen(
        [sys.executable, str(script)],
        start_new_session=True,
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    )
    marker = tmp_path / "study" / ".slow.partial" / "pid"
    while not (marker.exists() and marker.read_text().endswith(".")):
        assert process.poll() is None
        time.sleep(0.02)
    return process, int(marker.read_text()[:-1])


def _is_running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except FileNotFoundError:
        return False


_SLOW = "    (context.out / 'pid').write_text(f'{os.getpid()}.')\n    time.sleep(60)"


def test_control_c_in_the_terminal_ends_the_experiments_too(experiments, tmp_path):
    process, experiment = _start(tmp_path, experiments("slow", _SLOW).parent)
    os.killpg(process.pid, signal.SIGINT)  # as the terminal does: to the whole group
    _, errors = process.communicate()
    assert process.returncode != 0
    assert errors.count("KeyboardInterrupt") == 1  # the experiment's process says nothing
    assert not _is_running(experiment)
    assert not list((tmp_path / "study").glob(".*partial"))


def test_after_a_kill_no_experiment_runs_on_and_the_next_study_tidies_up(
    experiments, run, tmp_path
):
    module = experiments("slow", _SLOW)
    process, experiment = _start(tmp_path, module.parent)
    process.kill()
    process.communicate()
    while _is_running(experiment):
        time.sleep(0.02)
    assert (tmp_path / "study" / ".slow.partial").is_dir()
    module.write_text(module.read_text().replace(_SLOW, "    return measured(context)"))
    run("slow")
    assert not list((tmp_path / "study").glob(".*partial"))


def test_a_termination_keeps_what_is_finished_and_the_next_study_goes_on(
    experiments, run, tmp_path
):
    experiments("done")
    run("done")
    process, experiment = _start(tmp_path, experiments("slow", _SLOW).parent)
    os.killpg(process.pid, signal.SIGTERM)  # as a batch system does
    _, errors = process.communicate()
    assert process.returncode != 0
    assert "TerminatedError: SIGTERM" in errors
    assert not _is_running(experiment)
    assert not list((tmp_path / "study").glob(".*partial"))
    assert not (tmp_path / "study" / "failures").exists()
    assert run("done").outcomes[0].state == "earlier"


# ---- a full disk ----


def test_a_full_disk_ends_the_study_in_a_line_and_harms_nothing(experiments, run, tmp_path):
    experiments("good")
    earlier = run("good").metrics
    experiments("full", "    raise OSError(28, 'No space left on device')")
    with pytest.raises(InputError) as caught:
        run()
    assert "No space left on device" in str(caught.value)
    out = tmp_path / "study"
    assert _read(out / "metrics.json") == earlier
    assert not list(out.glob(".*partial"))
    assert run("good").outcomes[0].state == "earlier"


def test_a_full_disk_inside_another_error_is_found(experiments, run):
    experiments(
        "full",
        """
    try:
        raise OSError(28, "No space left on device")
    except OSError as error:
        raise InputError("log.csv", "", "cannot be written (No space left)") from error""",
    )
    with pytest.raises(InputError, match="No space left on device, while full ran"):
        run("full")


def test_a_full_disk_at_the_summary_leaves_the_earlier_one(experiments, run, tmp_path, monkeypatch):
    experiments("one")
    run("one", seed=1)
    before = {p: p.read_bytes() for p in (tmp_path / "study").iterdir() if p.is_file()}

    def full(self, *_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(InputError, match="No space left on device"):
        run("one", seed=1)
    monkeypatch.undo()
    assert {p: p.read_bytes() for p in (tmp_path / "study").iterdir() if p.is_file()} == before


# ---- the folder ----


def test_two_studies_do_not_write_in_one_folder(experiments, run, tmp_path):
    experiments("one")
    with (
        sole_writer(OutputFolder(tmp_path / "study").path),
        pytest.raises(InputError, match="another study"),
    ):
        run("one")


def test_a_file_in_the_way_is_refused_before_anything_runs(experiments, tmp_path):
    experiments("one", "    raise AssertionError")
    (tmp_path / "study").write_text("mine")
    with pytest.raises(InputError, match="is a file"):
        run_study([], tmp_path / "study", tmp_path)


def test_fewer_than_one_job_is_refused(experiments, run):
    experiments("one")
    with pytest.raises(InputError, match="--jobs"):
        run("one", jobs=0)
