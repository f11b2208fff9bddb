"""An experiment's result on disk: written with checksums, read back only if it is whole.

In the experiment's folder: metrics.json; result.json (what the report shows, and the fingerprint of
what the result depends on); config.yaml; figures and pages; and checksums.sha256 over all of
them, in the form that `sha256sum --check` reads.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from wrenchsight.analyses.output.outputs import OutputFolder, plain, plain_metrics
from wrenchsight.analyses.study.experiment import Experiment, ExperimentResult
from wrenchsight.analyses.study.fingerprint import Fingerprint, file_hash
from wrenchsight.analyses.study.outcome import look_up
from wrenchsight.analyses.study.study_folder import mark_experiment

CHECKSUMS: Final = "checksums.sha256"
_FORMAT: Final = 3  # of result.json; another one is not read back
_REQUIRED: Final = ("metrics.json", "result.json", "config.yaml")


class DamagedResultError(ValueError):
    """A stored result is not what was written."""


@dataclass(frozen=True)
class StoredResult:
    """What was read back of a whole result."""

    metrics: dict[str, Any]
    stored: dict[str, Any]  # title, section, notes, figures, pages, comparison, fingerprint


def write_result(
    path: Path,
    experiment: Experiment,
    result: ExperimentResult,
    fingerprint: Fingerprint,
    settings: dict[str, Any],
) -> None:
    """Writes a result into the experiment's folder, beside its figures and pages.

    Raises:
        ValueError: the result names a figure, a page or a metric that it does not have.
        TypeError: a metric or setting has no plain form.
        InputError: a file cannot be written.
    """
    folder = OutputFolder(path)
    metrics = plain_metrics(result.metrics)
    stored = plain(
        {
            "format": _FORMAT,
            "title": experiment.title,
            "section": experiment.section,
            **settings,
            "fingerprint": fingerprint,
            "notes": result.notes,
            "figures": result.figures,
            "pages": result.recordings,
            "comparison": result.comparison,
        }
    )
    for file in (*stored["figures"], *stored["pages"]):
        name = Path(file["path"])
        if name.is_absolute() or not (path / name).is_file():
            raise ValueError(f"{name} is not a file in the experiment's folder")
    for row in stored["comparison"]:
        look_up(metrics, row["key"])
    folder.write_json("metrics.json", metrics)
    folder.write_json("result.json", stored)
    configuration = {
        "experiment": experiment.name,
        **settings,
        "configuration": result.configuration,
    }
    folder.write_yaml("config.yaml", configuration)
    files = sorted(p.relative_to(path).as_posix() for p in path.rglob("*") if p.is_file())
    lines = [f"{file_hash(path / name)}  {name}\n" for name in files]
    folder.write_text(CHECKSUMS, "".join(lines))
    mark_experiment(path, experiment.name)


def read_result(path: Path) -> StoredResult:
    """Reads back what `write_result` wrote.

    Files that the user has put into the folder do no harm.

    Raises:
        FileNotFoundError: there is no result.
        DamagedResultError: it is not as it was written; the message says what is wrong.
    """
    if not path.is_dir():
        raise FileNotFoundError(path)
    try:
        lines = (path / CHECKSUMS).read_text(encoding="utf-8").splitlines()
        sums = {name: checksum for checksum, _, name in (line.partition("  ") for line in lines)}
        for name, checksum in sums.items():
            if file_hash(path / name) != checksum:
                raise DamagedResultError(f"{name} is not as it was written")
        metrics = json.loads((path / "metrics.json").read_text(encoding="utf-8"))
        stored = json.loads((path / "result.json").read_text(encoding="utf-8"))
        if stored["format"] != _FORMAT:
            raise DamagedResultError("it has the format of another version")
        shown = (file["path"] for file in (*stored["figures"], *stored["pages"]))
        for name in (*_REQUIRED, *shown):
            if name not in sums:
                raise DamagedResultError(f"{CHECKSUMS} does not list {name}")
    except FileNotFoundError as error:
        raise DamagedResultError(f"{Path(error.filename).name} is missing") from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise DamagedResultError(f"it cannot be read ({reason})") from None
    except (UnicodeDecodeError, json.JSONDecodeError, KeyError, TypeError, AttributeError):
        raise DamagedResultError("its files are not readable") from None
    return StoredResult(metrics, stored)
