"""Commands of which one input is spoilt, each made of a seed."""

import random
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fuzzing.clean_inputs import CleanInputs
from fuzzing.mutators import BINARY, NUMBERS, TABLE, WORDS, XML, YAML, Mutator, spoilt

_ESTIMATE = ("estimate", "log.csv", "--robot", "robot", "--prior", "30,2", "--out", "out")
_DATA_SET = ("estimate", "set", *_ESTIMATE[2:])
_WATCH = (
    "watch",
    "replay://log.csv?rate=0",
    "--robot",
    "robot",
    "--model",
    "model.yaml",
    "--view",
    "lines",
    "--record",
    "out",
)
_SHOW = ("robot", "show", "robot", "--out", "arm.html")


@dataclass(frozen=True)
class _Kind:
    """What is spoilt, how, and the command that reads it."""

    file: str
    mutators: tuple[Mutator, ...]
    commands: tuple[tuple[str, ...], ...]
    weight: int


_KINDS = {
    "csv": _Kind("log.csv", tuple(TABLE), (_ESTIMATE,), 8),
    "parquet": _Kind(
        "log.parquet", tuple(BINARY), (("estimate", "log.parquet", *_ESTIMATE[2:]),), 2
    ),
    "npz": _Kind("log.npz", tuple(BINARY), (("estimate", "log.npz", *_ESTIMATE[2:]),), 1),
    "mcap": _Kind("log.mcap", tuple(BINARY), (("estimate", "log.mcap", *_ESTIMATE[2:]),), 1),
    "description": _Kind(
        "format.yaml", tuple(YAML), ((*_ESTIMATE, "--log-format", "format.yaml"),), 3
    ),
    "robot": _Kind("robot/robot.yaml", tuple(YAML), (_SHOW, _SHOW, _ESTIMATE), 4),
    "urdf": _Kind(
        "robot/robot.urdf",
        tuple(XML),
        (_SHOW, ("robot", "robot/robot.urdf", "--out", "new/robot.yaml"), _ESTIMATE),
        4,
    ),
    "model": _Kind("model.yaml", tuple(YAML), ((*_ESTIMATE, "--model", "model.yaml"),), 3),
    "scenario": _Kind(
        "scenario.yaml",
        tuple(YAML),
        (("simulate", "--scenario", "scenario.yaml", "--no-recording", "--quick", "--out", "out"),),
        3,
    ),
    "placement": _Kind(
        "place.yaml", tuple(YAML), (("place", "--task", "place.yaml", "--quick"),), 2
    ),
    "redundancy": _Kind(
        "redundancy.yaml", tuple(YAML), (("redundancy", "--task", "redundancy.yaml"),), 2
    ),
    "configuration": _Kind(
        "estimate.yaml",
        tuple(YAML),
        (("estimate", "--config", "estimate.yaml", "--out", "out"),),
        3,
    ),
    "data set": _Kind("set/meta/info.json", tuple(YAML), (_DATA_SET,), 2),
    "episodes": _Kind("set/meta/episodes.jsonl", tuple(YAML), (_DATA_SET,), 1),
    "frames": _Kind("set/data/chunk-000/episode_000001.parquet", tuple(BINARY), (_DATA_SET,), 1),
    "watched log": _Kind("log.csv", tuple(TABLE), (_WATCH,), 1),
    "watched robot": _Kind("robot/robot.yaml", tuple(YAML), (_WATCH,), 1),
    "map": _Kind("jcn-map.yaml", tuple(YAML), (("jcn-map", "--config", "jcn-map.yaml"),), 1),
}

_OPTIONS = {
    "estimate": (
        "--prior",
        "--method",
        "--observer",
        "--k0",
        "--bandwidth",
        "--torque-samples",
        "--prior-force-sd",
        "--prior-moment-sd",
        "--max-force-sd",
        "--step",
        "--damping",
        "--truncation",
        "--max-gap",
        "--reference",
        "--reference-frame",
        "--table",
        "--reference-turn",
        "--reference-sign",
        "--reference-tare",
        "--reference-delay",
        "--false-alarms-per-hour",
        "--log-format",
        "--model",
        "--config",
        "--robot",
        "--out",
    ),
    "jcn-map": ("--samples", "--slice", "--cone-axis", "--cone-deg", "--points", "--seed", "--out"),
    "simulate": ("--scenario", "--name", "--robot", "--model", "--duration", "--seed", "--out"),
    "identify": ("--robot", "--validate", "--cutoff", "--friction", "--load", "--refresh", "--out"),
    "payload": ("--robot", "--model", "--empty", "--gain-sd", "--name", "--out"),
    "place": ("--task", "--robot", "--objective", "--solver", "--model", "--method", "--seed"),
    "redundancy": ("--task", "--robot", "--config", "--out"),
    "excite": ("--robot", "--measure", "--clearance", "--floor", "--acceleration", "--seed"),
    "robot": ("--base", "--flange", "--out"),
    "study": ("--data", "--seed", "--jobs"),
}
_PLAIN = {
    "estimate": _ESTIMATE[1:-2],
    "jcn-map": ("--samples", "50", "--robot", "robot"),
    "simulate": ("--duration", "0.02", "--no-recording"),
    "identify": ("log.csv", "--robot", "robot"),
    "payload": ("log.csv", "--robot", "robot", "--model", "model.yaml"),
    "place": ("--task", "place.yaml", "--quick"),
    "redundancy": ("--task", "redundancy.yaml"),
    "excite": ("--robot", "nowhere"),
    "robot": ("show", "robot"),
    "study": ("nothing",),
}
_METHODS = ("inverse", "force_only", "bayesian", "damped", "truncated", "kalman", "momentum")
_MEANT = (*_METHODS, "kalman", "live", "log", "held", "trapezoidal", "parquet")
_FILES = ("log.csv", "robot", "model.yaml", "robot/robot.urdf", "format.yaml", ".", "..", "nowhere")


@dataclass(frozen=True)
class Case:
    """A command in a folder of its own.

    Attributes:
        spoilt: the file of the folder that is spoilt, or "".
        what: was done to it.
    """

    seed: int
    kind: str
    spoilt: str
    what: str
    arguments: tuple[str, ...]


def make_case(seed: int, clean: CleanInputs, folder: Path) -> Case:
    """Copies the clean inputs into `folder` and spoils one, or the command's options."""
    rng = random.Random(seed)
    shutil.copytree(clean.folder, folder)
    if rng.random() < 0.15:
        return _odd_options(seed, rng)
    names = list(_KINDS)
    (name,) = rng.choices(names, [_KINDS[name].weight for name in names])
    kind = _KINDS[name]
    path = folder / kind.file
    data, description = spoilt(path.read_bytes(), kind.mutators, rng)
    path.write_bytes(data)
    return Case(seed, name, kind.file, description, rng.choice(kind.commands))


def _odd_options(seed: int, rng: random.Random) -> Case:
    command = rng.choice(list(_OPTIONS))
    words = [command, *_PLAIN[command]]
    pick: Callable[[], str] = lambda: rng.choice((*NUMBERS, *WORDS, *_MEANT, *_MEANT, *_FILES))  # noqa: E731
    for _ in range(rng.choice((1, 1, 2, 3))):
        choice = rng.randrange(6)
        if choice < 4:
            option = rng.choice(_OPTIONS[command])
            value = pick()
            words += [f"{option}={value}"] if rng.random() < 0.5 else [option, value]
        elif choice == 4 and len(words) > 1:
            del words[rng.randrange(1, len(words))]
        else:
            words.insert(rng.randrange(1, len(words) + 1), pick())
    if command == "study":
        # No experiment, whatever an option before takes as its value: they take minutes.
        words += ["--", "nothing"]
    # What an operating system hands over has neither of these.
    clean = [word.replace("\0", "") for word in words]
    return Case(seed, "command line", "", " ".join(clean)[:200], tuple(clean))
