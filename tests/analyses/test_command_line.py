"""The command line: what it prints, where, and with which exit code."""

import io
import itertools
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from called_commands import invoke, refused
from rich.console import Console

from wrenchsight.analyses.output.compilation import ANNOUNCEMENT
from wrenchsight.analyses.output.progress import Progress, ProgressDisplay
from wrenchsight.analyses.study import study
from wrenchsight.analyses.study.outcome import StudyResult
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.models.files.input_error import InputError

ROOT = Path(study.__file__).resolve().parents[2]
COMMANDS = ("study", "identify", "estimate", "simulate")
_OTHER_SPECIMEN = (
    *("identify", "a.csv", "--robot", "ur10e"),
    *("--refresh", "model.yaml", "--other-specimen"),
)


def _run(*arguments, python=("-m", "analyses"), **options):
    return subprocess.run(
        [sys.executable, *python, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        **options,
    )


# ---- help ----


@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_has_help(command):
    result = invoke(command, "--help")
    assert result.exit_code == 0
    assert "--out" in result.stdout


@pytest.mark.parametrize(
    ("program", "heavy"),
    [
        ("app(['study', '--help'])", ("numpy", "scipy", "matplotlib", "pyarrow")),
        ("app(['--help'])", ("numpy", "wrenchsight.analyses.commands.estimate")),
        ("app(['study', '--list'])", ("scipy", "matplotlib", "jinja2")),
    ],
)
def test_help_and_lists_import_nothing_heavy(program, heavy):
    """Importing Drake alone takes a second."""
    program = (
        "import sys; from wrenchsight.analyses.__main__ import app\n"
        f"try: {program}\n"
        "except SystemExit: pass\n"
        f"heavy = ('pydrake', 'numba', 'torch', *{heavy})\n"
        "sys.exit(str([name for name in heavy if name in sys.modules]))"
    )
    assert _run(program, python=("-c",)).stderr.strip() == "[]"


def test_alone_it_shows_the_five_uses_with_a_command_each():
    shown = " ".join(invoke().output.split())
    assert shown == " ".join(invoke("--help").output.split())
    assert all(command in shown for command in COMMANDS)
    for use in (
        "Description of an arm: wrenchsight robot ARM.urdf",
        "Its dynamic model: wrenchsight identify LOG",
        "Force at the tool: wrenchsight estimate LOG",
        "Place of a task: wrenchsight place",
        "Test of the method: wrenchsight simulate",
    ):
        assert use in shown


def test_version_and_list():
    assert invoke("--version").stdout.startswith("wrenchsight ")
    assert invoke("study", "--list").stdout.split() == list(REGISTRY.entries())


# ---- what a user can get wrong ----


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("study", "bandwith"), ("did you mean bandwidth?", *REGISTRY.entries())),
        (("study", "--out", "pyproject.toml"), ("pyproject.toml: is a file", "--out")),
        (("identify", "nowhere.csv", "--robot", "ur10e"), ("nowhere.csv",)),
        (("identify", "nowhere.csv", "--robot", "ur11e"), ("ur11e", "ur10e")),
        (("identify", "models", "--robot", "ur10e"), ("models",)),
        (("estimate", "nowhere.csv", "--robot", "ur10e"), ("nowhere.csv",)),
        (("estimate", "a.csv", "--robot", "ur10e", "--k0", "5,x"), ("--k0", "'5,x'")),
        (("estimate", "a.csv", "--robot", "ur10e", "--method", "best"), ("best", "bayesian")),
        (("robot", "export", "--to", "mjcf"), ("--model", "is missing")),
        (("robot", "arm.urdf", "--model", "model.yaml"), ("--model", "robot export")),
        # What another form of the command would take was ignored.
        (("robot", "arm.urdf", "--to", "mjcf"), ("--to", "robot export")),
        (("robot", "show", "ur10e", "--flange", "tool0"), ("--flange", "robot URDF")),
        (("robot", "show", "ur10e", "--xacro-arg", "a:=1"), ("--xacro-arg", "robot URDF")),
        (("robot", "export", "--model", "model.yaml", "--base", "b"), ("--base", "robot URDF")),
        (("identify", "a.csv", "--robot", "ur10e", "--part", "0,5"), ("--part", "--refresh")),
        ((*_OTHER_SPECIMEN, "--scale"), ("--other-specimen", "--scale")),
        ((*_OTHER_SPECIMEN, "--part", "0,5"), ("--part", "LOG=BEGIN,END")),
        (("simulate", "--scenario", "Defalt"), ("Defalt", "Default")),
        (("simulate", "--scenario", "nowhere.yaml"), ("nowhere.yaml",)),
        (("simulate", "--duration", "-1"), ("duration",)),
        (("estimat", "a.csv"), ('no command "estimat"', 'did you mean "estimate"?', "--help")),
    ],
)
def test_one_line_and_exit_code_2(monkeypatch, arguments, expected):
    monkeypatch.chdir(ROOT)
    line = refused(*arguments)
    for text in expected:
        assert text in line


def test_a_mistyped_experiment_is_one_line_in_a_process_of_its_own():
    result = _run("study", "bandwith")
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("study", "--seed", "x"),
        ("study", "--jobs", "0"),
        ("study", "--nope"),
        ("nope",),
        ("identify", "log.csv"),
        ("identify", "--robot", "ur10e"),
    ],
)
def test_usage_errors_exit_with_2_too(arguments):
    assert "--help)" in refused(*arguments)


@pytest.mark.parametrize(
    ("error", "line", "code"),
    [
        (
            InputError("a.csv", "line 3", "is\nempty", "fill it"),
            "a.csv: line 3: is empty; fill it",
            2,
        ),
        (OSError(28, "No space left on device", "out/x"), "out/x: No space left on device", 2),
        (OSError("odd"), "odd", 2),
        (KeyboardInterrupt(), "interrupted; what was written is whole", 130),
    ],
)
def test_errors_of_any_command_become_one_line(monkeypatch, error, line, code):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(study, "run_study", fail)
    result = invoke("study", "bandwidth")
    assert result.exit_code == code
    assert result.stderr == line + "\n"
    assert result.stdout == ""


def test_a_defect_of_ours_keeps_its_traceback(monkeypatch):
    monkeypatch.setattr(study, "run_study", lambda *_, **__: 1 / 0)
    result = invoke("study", "bandwidth")
    assert result.exit_code == 1
    assert isinstance(result.exception, ZeroDivisionError)


def test_a_reader_that_leaves_is_no_error():
    command = f"{sys.executable} -m analyses study --list | true; echo ${{PIPESTATUS[0]}}"
    result = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert "Traceback" not in result.stderr


# ---- study ----


def test_a_study_prints_progress_on_stderr_and_a_table_last(experiments, tmp_path):
    experiments("one")
    result = invoke("study", "--out", tmp_path / "out", "--data", tmp_path, "--seed", 3)
    assert result.exit_code == 0
    assert re.fullmatch(r"one  started\none  done in \d+\.\d s\n", result.stderr)
    lines = result.stdout.splitlines()
    assert "article" in lines[0]
    assert "here" in lines[0]
    assert any(
        "Largest error in Y [bold] [N]" in s and "24.86" in s and "24.70" in s for s in lines
    )
    assert lines[-1] == f"report: {tmp_path / 'out' / 'report.html'}"
    assert '"seed": 3' in (tmp_path / "out" / "one" / "result.json").read_text()


def test_failed_experiments_exit_with_1_after_the_others(experiments, tmp_path):
    experiments("bad", "raise ValueError('no [torque]')")
    experiments("good")
    result = invoke("study", "--out", tmp_path / "out", "--jobs", 1)
    assert result.exit_code == 1
    assert "bad   failed: ValueError: no [torque]" in result.stderr
    assert "good  done" in result.stderr
    assert "24.70" in result.stdout


def test_absent_recordings_are_said_in_a_line(experiments, tmp_path):
    experiments("real", needs=("ur10e", "staubli_tx40"))
    experiments("other", needs=("ur10e",))
    result = invoke("study", "--out", tmp_path / "out", "--data", tmp_path / "none", "--jobs", 1)
    assert result.exit_code == 0, result.stderr + result.stdout
    command = "`wrenchsight data fetch ur10e`"
    assert f"other  skipped: needs the recordings ur10e; {command}" in result.stderr
    (line,) = [line for line in result.stdout.splitlines() if line.startswith("missing")]
    missing = "missing recordings: ur10e (real, other), staubli_tx40 (real)"
    assert line.startswith(f"{missing}; to get them: {command}; staubli_tx40: ask")


def test_data_lists_the_sets_and_says_where_each_is(tmp_path):
    result = invoke("data", "--data", tmp_path)
    assert result.exit_code == 0
    kinds = {line.split()[0]: line for line in result.stdout.splitlines() if line}
    assert " bundled " in kinds["panda_ati_gamma"]
    assert " missing " in kinds["ur10e_contact"]
    assert "GPL-3.0" in kinds["ur10e_contact"]
    (about,) = [line for line in result.stdout.splitlines() if line.startswith("ur10e:")]
    assert about.endswith("`wrenchsight data fetch ur10e`")
    users = dict(itertools.pairwise(result.stdout.splitlines()))[about]
    assert users.startswith("  needed by ") and " ur10e-payload, " in users
    assert users.endswith("; read if there by friction-laws, benchmark")
    result = invoke("data", "path", "panda_ati_gamma", "--data", tmp_path)
    assert (Path(result.stdout.strip()) / "SOURCE.md").is_file()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("path", "ur10e"),
            "ur10e: these recordings are not there; `wrenchsight data fetch ur10e`",
        ),
        (("get",), "data: cannot 'get'; known are list, fetch, path"),
        (("fetch", "ur11e"), "data: no set of recordings is named 'ur11e'; known are"),
        (("fetch", "staubli_tx40"), "staubli_tx40: cannot be fetched; ask"),
        (("fetch", "ur10e", "--mirror", "here"), "--mirror: is 'here', expected an address"),
        (
            ("fetch", "ur10e_pushes", "--mirror", "file:///none"),
            "cannot be read (No such file or directory); run it again: it resumes where it was "
            "cut; a set that the mirror lacks comes from the public host, without --mirror",
        ),
    ],
)
def test_data_refuses_in_one_line(tmp_path, monkeypatch, arguments, words):
    monkeypatch.setattr("time.sleep", lambda seconds: None)
    result = invoke("data", *arguments, "--data", tmp_path)
    assert result.exit_code == 2
    (line,) = [line for line in result.stderr.splitlines() if words in line]
    assert line == result.stderr.splitlines()[-1]


def test_options_reach_the_study(monkeypatch, tmp_path):
    seen = {}

    def note(names, out, data, **options):
        seen.update(names=names, out=out, data=data, **options)
        return StudyResult(out, (), {}, out / "report.html")

    monkeypatch.setattr(study, "run_study", note)
    arguments = ("bandwidth", "--seed", 4, "--quick", "--jobs", 3, "--data", "d", "--fresh")
    arguments += ("--out", tmp_path, "--truth", "plain")
    assert invoke("study", *arguments).exit_code == 0
    del seen["watch"]
    expected = {"names": ["bandwidth"], "out": tmp_path, "data": Path("d")}
    assert seen == expected | {
        "seed": 4,
        "methods": [],
        "quick": True,
        "jobs": 3,
        "fresh": True,
        "truth": "plain",
    }


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_is_one_line_and_its_code(experiments, tmp_path, ended, number, code):
    program = f"""
    import sys
    from wrenchsight.analyses import __main__
    sys.argv = ['wrenchsight', 'study', 'slow', '--out', {str(tmp_path / "out")!r}]
    __main__.main()
    """
    module = experiments("slow", "(context.out / 'begun').touch()\ntime.sleep(60)")
    begun = tmp_path / "out" / ".wrenchsight.partial/work/slow/result/begun"
    returned, errors = ended(module, program, begun.exists, number)
    assert returned == code
    lines = ["slow  started", "slow  interrupted", "interrupted; what was written is whole"]
    assert errors.splitlines() == lines
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        ".wrenchsight.json",
        "metrics.json",
        "report.html",
        "timings.json",
    ]


def test_a_full_disk_is_one_line_and_2(experiments, tmp_path):
    experiments("full", "raise OSError(28, 'No space left on device', str(context.out / 'f'))")
    result = invoke("study", "--out", tmp_path / "out", "--jobs", 1)
    assert result.exit_code == 2
    lines = result.stderr.splitlines()
    assert lines[-1].startswith(f"{tmp_path / 'out'}: ")
    for text in ("No space left on device", "while full ran", "what is finished is kept"):
        assert text in lines[-1]
    assert "Traceback" not in result.stderr


# ---- progress ----


def _written(on_terminal, events, fleeting=False):
    file = io.StringIO()
    console = Console(file=file, force_terminal=on_terminal, width=100)
    with ProgressDisplay(console, ("one", "longer"), fleeting=fleeting) as watch:
        for event in events:
            watch(event)
    return file.getvalue()


EVENTS = (
    Progress("one", "running"),
    Progress("one", "running", 0.0, ANNOUNCEMENT),
    Progress("one", "running", 0.2, "reading [bold]"),
    Progress("one", "running", 0.8, "solving"),
    Progress("longer", "skipped", 1.0, "needs data"),
    Progress("one", "done", 1.0),
)


def test_in_a_log_there_are_few_lines_and_no_control_characters():
    text = _written(False, EVENTS)
    assert text.splitlines() == [
        "one     started",
        f"one     {ANNOUNCEMENT}",
        "longer  skipped: needs data",
        "one     done",
    ]
    assert all(character.isprintable() or character == "\n" for character in text)


def test_fleeting_progress_says_in_a_log_only_that_there_is_a_wait():
    assert _written(False, EVENTS, fleeting=True) == f"one     {ANNOUNCEMENT}\n"


def test_long_work_gives_a_sign_of_life_in_a_log(monkeypatch):
    clock = iter(range(0, 1000, 15))
    monkeypatch.setattr("wrenchsight.analyses.output.progress.time.monotonic", lambda: next(clock))
    events = [Progress("one", "running", k / 10, "solving") for k in range(6)]
    assert _written(False, events).splitlines() == [
        "one     started",
        "one     20 %  solving",
        "one     40 %  solving",
    ]


def test_on_a_terminal_there_are_bars():
    text = _written(True, EVENTS[:3])
    assert "reading [bold]" in text
    assert "━" in text


# ---- estimate ----


def test_an_estimate_prints_its_table_and_its_doubts(monkeypatch, tmp_path):
    from wrenchsight.analyses.methods.estimate import estimation

    force = {"mean_n": -24.6789, "rms_n": 25.5, "max_abs_n": 40.34, "mean_sd_n": None}
    metrics = {
        "valid": {"wrench": {"fz": force}},
        "prior": {"force_sd_n": 15.71, "moment_sd_nm": 2.579, "rule": "evidence of the log"},
    }
    result = SimpleNamespace(
        metrics=lambda: metrics,
        num_samples=5010,
        valid_share=0.676,
        notices=("a drop-out was bridged",),
        warnings=("it extrapolates [mostly]",),
        table=tmp_path / "wrench.csv",
        invalid=("32.4 % not valid: 32.4 % settling", "what would help: time"),
        contacts=("contact at t = 1.20 s for 0.40 s, up to 31 N, not at E: link 4",),
        comparison=None,
    )
    monkeypatch.setattr(estimation, "estimate_log", lambda *_: result)
    shown = invoke("estimate", "log.csv", "--robot", "r", "--out", tmp_path)
    assert shown.exit_code == 0
    assert shown.stderr == ""
    lines = shown.stdout.splitlines()
    assert lines[1].split() == ["fz", "-24.68", "25.50", "40.34", "–", "N"]
    assert "5010 samples, 67.6 % valid; prior: force sd 15.7 N, moment sd 2.58 N m" in lines[2]
    assert lines[3:5] == ["32.4 % not valid: 32.4 % settling", "what would help: time"]
    assert "note: it extrapolates [mostly]" in lines
    assert "contact at t = 1.20 s for 0.40 s, up to 31 N, not at E: link 4" in lines
    assert str(tmp_path / "wrench.csv") in lines[-1]


# ---- simulate ----


@pytest.mark.parametrize("sensor", [True, False])
def test_a_simulation_prints_its_errors_and_its_files(monkeypatch, tmp_path, sensor):
    from wrenchsight.analyses.methods.simulate import simulation

    units = {"fx": "n", "fy": "n", "fz": "n", "mx": "nm", "my": "nm", "mz": "nm"}
    errors = {f"rmse_{axis}_{unit}": 0.5 for axis, unit in units.items()}
    errors |= {f"max_error_{axis}_{unit}": 1.25 for axis, unit in units.items()}
    metrics = errors | {"duration_s": 2.0, "valid_share": 0.9, "coverage_share": 0.95}
    if sensor:
        metrics["sensor"] = errors
    result = SimpleNamespace(
        metrics=lambda: metrics,
        real_time_factor=4.26,
        robot=SimpleNamespace(notices=("12 meshes dropped: drawn without them",)),
        notices=(),
        files=(tmp_path / "log.csv",),
    )
    monkeypatch.setattr(simulation, "simulate_scenario", lambda *_, **__: result)
    shown = invoke("simulate")
    assert shown.exit_code == 0
    lines = shown.stdout.splitlines()
    assert lines[2].split() == ["fx", "N", *(("0.500", "1.250") * (2 if sensor else 1))]
    assert lines[7].split()[:3] == ["mz", "N", "m"]
    assert "4.3 times real time; 90 % of the readings valid, 95 %" in shown.stdout
    assert "note: 12 meshes dropped: drawn without them" in lines
    assert lines[-1] == f"wrote {tmp_path / 'log.csv'}"
