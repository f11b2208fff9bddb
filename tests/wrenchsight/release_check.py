"""Builds wheel and sdist, installs each into an empty environment, runs what a user runs first.

    python tests/wrenchsight/release_check.py --python python3.11 --python python3.12

It needs a package index, gigabytes of disk on 3.12 and newer (PyTorch's GPU libraries), and some
minutes an environment: kernels are compiled anew. `--warm` takes those of this checkout, where they
fit. An environment is removed when it has passed. `make release-check` calls it.
"""

import argparse
import json
import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
KINDS = ("wheel", "sdist")
SOURCES = (
    "pyproject.toml",
    "README.md",
    "LICENSE",
    "wrenchsight",
    "analyses",
    "diagrams",
    "models",
    "systems",
)
SHORT = ("--starts", "4", "--iterations", "10", "--no-record", "--seed", "1")


def run(*command: object, cwd: Path | None = None) -> str:
    """Runs a command with nothing of this environment; returns what it printed on stdout."""
    words = [str(word) for word in command]
    environment = {
        k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
    }
    done = subprocess.run(
        words, cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        sys.exit(f"{' '.join(words)}\nended with {done.returncode}:\n{done.stdout}{done.stderr}")
    return done.stdout


def build(work: Path) -> dict[str, Path]:
    """Both distributions, built of a copy: a build writes beside its sources."""
    copy = work / "checkout"
    shutil.rmtree(copy, ignore_errors=True)
    copy.mkdir(parents=True)
    ignored = shutil.ignore_patterns("__pycache__", "*.nb[ic]")
    for name in SOURCES:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, copy / name, symlinks=True, ignore=ignored)
        else:
            shutil.copy(source, copy)
    built = {}
    for kind in KINDS:
        program = f"from setuptools.build_meta import build_{kind} as b; print(b({str(work)!r}))"
        built[kind] = work / run(sys.executable, "-c", program, cwd=copy).split()[-1]
    return built


def check(python: str, distribution: Path, work: Path, warm: bool, torch: bool) -> None:
    """Installs a distribution into an environment of its own; runs commands in an empty folder."""
    environment, folder = work / "environment", work / "user"
    for place in (environment, folder):
        shutil.rmtree(place, ignore_errors=True)
    folder.mkdir(parents=True)
    run(python, "-m", "venv", environment)
    pip = (
        environment / "bin" / "python",
        "-m",
        "pip",
        "install",
        "--quiet",
        "--constraint",
        ROOT / "constraints.txt",
    )
    if torch:
        run(*pip, distribution)
    else:
        needed = run(*pip[:1], "-c", _REQUIREMENTS.format(str(ROOT / "pyproject.toml"))).split()
        run(*pip, *needed)
        run(*pip, "--no-deps", distribution)
    if warm:
        _take_kernels(environment)
    command = environment / "bin" / "wrenchsight"
    shutil.copy(ROOT / "examples" / "quickstart.py", folder)

    def wrenchsight(*words: object) -> str:
        return run(command, *words, cwd=folder)

    version = wrenchsight("--version").split()[-1]
    assert version == _version(), version
    if "data" in re.findall(r"^│ (\S+)", wrenchsight("--help"), re.MULTILINE):
        assert "ur10e" in wrenchsight("data", "list")
    printed = run(environment / "bin" / "python", "quickstart.py", "quick", cwd=folder)
    assert not re.search(r"\b(nan|inf)\b", printed), printed
    (valid,) = re.findall(r"(\d+) % of \d+ readings valid", printed)
    assert int(valid) >= 90, printed
    wrenchsight("excite", "--robot", "ur10e", *SHORT, "--out", "excite")
    recorded = ("simulate", "--robot", "ur10e", "--no-recording")
    for motion in ("trajectory", "validation"):
        wrenchsight(*recorded, "--motion", f"excite/{motion}.yaml", "--out", motion)
    wrenchsight(
        "identify",
        "trajectory/log.csv",
        "--validate",
        "validation/log.csv",
        "--robot",
        "ur10e",
        "--out",
        "model",
    )
    model = ("--robot", "ur10e", "--model", "model/model.yaml")
    table = wrenchsight("estimate", "validation/log.csv", *model, "--out", "reading")
    metrics = json.loads((folder / "model" / "metrics.json").read_text(encoding="utf-8"))
    errors = metrics["validation"]["log_2"]["rmse_nm"]
    assert len(errors) == 6 and all(math.isfinite(e) and e < 30.0 for e in errors), errors
    (read,) = re.findall(r"samples, ([\d.]+) % valid", table)
    assert float(read) >= 50.0, table
    assert (folder / "reading" / "wrench.csv").stat().st_size > 0
    wrenchsight("watch", "replay://validation/log.csv?rate=0", *model, "--view", "none")
    print(
        f"  quickstart: {valid} % valid; identify: RMSE on the second motion "
        f"{' '.join(f'{e:.2f}' for e in errors)} N m; estimate: {read} % valid"
    )
    for place in (environment, folder):
        shutil.rmtree(place)


_REQUIREMENTS = """
import tomllib
named = tomllib.load(open({0!r}, "rb"))["project"]["dependencies"]
print(*(name for name in named if not name.startswith("torch")))
"""


def _version() -> str:
    (version,) = re.findall(
        r'^version = "(.+)"$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE
    )
    return str(version)


def _take_kernels(environment: Path) -> None:
    (package,) = environment.glob("lib/python*/site-packages/wrenchsight")
    for folder in ("models", "systems", "diagrams", "analyses"):
        for kernel in (ROOT / folder).rglob("__pycache__/*.nb[ic]"):
            to = package / folder / kernel.relative_to(ROOT / folder)
            to.parent.mkdir(exist_ok=True)
            shutil.copy2(kernel, to)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=Path("out/release"))
    parser.add_argument("--python", action="append", help="an interpreter; may be repeated")
    parser.add_argument("--kind", choices=KINDS, action="append", help="by default both")
    parser.add_argument("--warm", action="store_true", help="take this checkout's compiled kernels")
    parser.add_argument("--without-torch", action="store_true", help="install all but PyTorch")
    options = parser.parse_args()
    work = options.work.resolve()
    built = build(work)
    for python in options.python or [sys.executable]:
        for kind in options.kind or KINDS:
            print(f"{built[kind].name} on {run(python, '--version').strip()} ...", flush=True)
            check(python, built[kind], work, options.warm, not options.without_torch)
    print(f"passed; to be published: {', '.join(str(file) for file in built.values())}")


if __name__ == "__main__":
    main()
