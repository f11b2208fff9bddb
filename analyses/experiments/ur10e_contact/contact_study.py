"""All contact runs read by all methods and judged: the numbers of experiment `ur10e-contact`."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_runs import (
    CONTROLLERS,
    INTERVALS,
    JUDGED,
    SCENES,
    read_run,
    write_rounded,
)
from wrenchsight.analyses.experiments.ur10e_contact.contact_friction import (
    air_fit,
    plain_friction,
    sensor_fit,
)
from wrenchsight.analyses.experiments.ur10e_contact.contact_reading import (
    PreparedRun,
    averaged,
    prepare,
    read_article,
    read_by_hand,
    read_command,
    read_gravity,
    read_ours,
    read_two_joints,
)
from wrenchsight.analyses.methods.calibration.specimen_refitting import carried_over, refit_specimen
from wrenchsight.analyses.methods.sensors.judged_force import (
    ForceReading,
    Judgement,
    pooled_judgement,
)
from wrenchsight.models.calibration.specimen_friction import SpecimenFit
from wrenchsight.models.files.configuration import save_configuration
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot

METHODS: Final = (
    *("no_sensor", "command", "calibrated", "article", "by_hand", "two_joints", "gravity"),
    "carried_over",
)
SPEEDS: Final = ("v10", "v25", "v90")
_UNKNOWN_SCATTER = 2.0  # N m, of a joint that does not move in the air, for the article's band

# The runs on which every constant of `ContactConfig` was settled; all others only check them.
SETTLED_ON: Final = frozenset(
    {
        "direct_ACF_F100_r0.0z0_v0.10",
        "direct_ACF_F100_r0.1z10_v0.25",
        "direct_UR_F100_g0.5_v0.25",
        "ramp_ACF_F15_r0.0z0_v0.10",
        "ramp_ACF_F15_r0.0z0_v0.25",
        "ramp_ACF_F35_r0.0z0_v0.25",
        "ramp_ACF_F55_r0.0z0_v0.10",
        "ramp_UR_F15_g0.5_v0.10",
        "ramp_UR_F15_g1_v0.25",
        "ramp_UR_F35_g1_v0.10",
        "ramp_UR_F55_g0.5_v0.25",
        "straight_ACF_F15_r0.0z0_v0.25",
        "straight_ACF_F15_r0.0z0_v0.90",
        "straight_ACF_F15_r0.1z10_v0.10",
        "straight_ACF_F35_r0.1z10_v0.25",
        "straight_ACF_F35_r0.1z10_v0.90",
        "straight_ACF_F55_r0.0z0_v0.10",
        "straight_UR_F15_g0.5_v0.25",
        "straight_UR_F15_g0.5_v0.90",
        "straight_UR_F15_g1_v0.10",
        "straight_UR_F35_g0.5_v0.90",
        "straight_UR_F35_g1_v0.10",
        "straight_UR_F55_g0.5_v0.25",
    }
)


@dataclass(frozen=True, eq=False)
class ReadRun:
    """A run and its readings by method, one value per block."""

    prepared: PreparedRun
    readings: Mapping[str, ForceReading]

    def judged(self, method: str, interval: str) -> Judgement | None:
        """A method over an interval; None where the run has it not, or no reading there."""
        windows = self.prepared.windows(interval)
        if not len(windows):
            return None
        truth = self.prepared.truth[windows].mean(axis=1)
        return Judgement.of(averaged(self.readings[method], windows), truth)


@dataclass(frozen=True, eq=False)
class ContactStudy:
    """What the experiment reports.

    Attributes:
        runs: read by all methods.
        air: the friction fit without a sensor.
        plain: the same with the article's law.
    """

    runs: tuple[ReadRun, ...]
    air: SpecimenFit
    plain: SpecimenFit


def prepare_runs(
    files: Sequence[Path],
    robots: Mapping[str, Robot],
    identified: IdentifiedModel,
    progress: Callable[[float], None],
) -> list[PreparedRun]:
    """Reads the runs, with published masses and the rotors of another specimen.

    Args:
        robots: with the tool of each controller.
        identified: model of another specimen.

    Raises:
        InputError: one is damaged.
    """
    known, prepared = carried_over(_law(identified)), []
    models = {
        key: replace(identified, inertial_parameters=robot.chain.inertial_parameters)
        for key, robot in robots.items()
    }
    for k, path in enumerate(files):
        progress(k / len(files))
        run = read_run(path)
        own = run.name.controller
        prepared.append(prepare(run, robots[own], models[own], known))
    return prepared


def read_runs(
    prepared: Sequence[PreparedRun],
    files: Sequence[Path],
    identified: IdentifiedModel,
    progress: Callable[[float], None],
) -> ContactStudy:
    """Fits the friction and reads every run by every method.

    Args:
        prepared: the runs.
        files: they are of.
        identified: model of another specimen.
        progress: told the share of the work.
    """
    known = carried_over(_law(identified))
    rows = [run.rows for run in prepared]
    air, plain = air_fit(rows, known), air_fit(rows, plain_friction())
    torque_sd = np.where(np.isfinite(plain.scatter), plain.scatter, _UNKNOWN_SCATTER)
    runs = []
    with TemporaryDirectory() as folder:
        command = _Command(prepared, identified, Path(folder))
        for k, (run, file) in enumerate(zip(prepared, files, strict=True)):
            progress(k / len(prepared))
            others = [other for i, other in enumerate(rows) if i != k]
            calibrated = sensor_fit(others, known) if others else air
            readings = {
                "no_sensor": read_ours(run, air.law),
                "command": command.read(run, file),
                "calibrated": read_ours(run, calibrated.law, calibrated.gain),
                "article": read_article(run, plain.law, torque_sd),
                "by_hand": read_by_hand(run),
                "two_joints": read_two_joints(run),
                "gravity": read_gravity(run),
                "carried_over": read_ours(run, known),
            }
            runs.append(ReadRun(run, readings))
    return ContactStudy(tuple(runs), air, plain)


class _Command:
    """The files that `estimate` is given: robot.yaml with each tool, and today's model.yaml."""

    def __init__(
        self, prepared: Sequence[PreparedRun], identified: IdentifiedModel, folder: Path
    ) -> None:
        self._folder = folder
        for controller in CONTROLLERS:
            own = [run for run in prepared if run.run.name.controller == controller]
            if not own:
                continue
            robot = own[0].robot
            urdf = (robot.source.parent / robot.config.urdf).resolve()
            save_configuration(replace(robot.config, urdf=urdf), folder / f"{controller}.yaml")
            free = [(run.run.log, run.run.is_free) for run in own]
            refit = refit_specimen(free, robot, identified)
            refit.model.save(folder / f"{controller}_model.yaml")

    def read(self, run: PreparedRun, file: Path) -> ForceReading:
        """What the command writes of a run."""
        own = run.run.name.controller
        robot, model = self._folder / f"{own}.yaml", self._folder / f"{own}_model.yaml"
        log = self._folder / file.name
        write_rounded(run.run, file, log)
        return read_command(run, log, robot, model, self._folder / file.stem)


def _law(identified: IdentifiedModel) -> PreslidingFriction:
    law = identified.friction
    assert isinstance(law, PreslidingFriction)
    return law


def contact_metrics(study: ContactStudy) -> dict[str, Any]:
    """Bias, scatter and band by scene, controller, speed, interval and method, and pooled."""
    found: dict[tuple[str, str, str, str], list[Judgement]] = defaultdict(list)
    by_force: dict[tuple[str, str, str], list[Judgement]] = defaultdict(list)
    halves: dict[tuple[str, str, str], list[Judgement]] = defaultdict(list)
    for read in study.runs:
        name = read.prepared.run.name
        half = "settled" if name.stem in SETTLED_ON else "checked"
        for method in METHODS:
            for interval in INTERVALS:
                judgement = read.judged(method, interval)
                if judgement is None:
                    continue
                found[name.group, name.speed_key, interval, method].append(judgement)
                by_force[f"f{name.force}", interval, method].append(judgement)
                if interval in JUDGED:
                    kind = "slide" if interval == "slide" else "rest"
                    halves[half, kind, method].append(judgement)
    metrics: dict[str, Any] = {
        f"{scene}_{controller}": {
            speed: {
                interval: {
                    method: pooled_judgement(
                        found.get((f"{scene}_{controller}", speed, interval, method), [])
                    )
                    for method in METHODS
                }
                for interval in INTERVALS
            }
            for speed in SPEEDS
        }
        for scene in SCENES
        for controller in CONTROLLERS
    }
    metrics["by_force"] = _nested({key: pooled_judgement(v) for key, v in by_force.items()})
    metrics["summary"] = _summary(found)
    for half in ("settled", "checked"):
        metrics[half] = {
            kind: {
                method: pooled_judgement(halves.get((half, kind, method), [])) for method in METHODS
            }
            for kind in ("rest", "slide")
        }
    return metrics


def _nested(flat: Mapping[tuple[str, str, str], Any]) -> dict[str, Any]:
    nested: dict[str, Any] = {}
    for (a, b, c), value in sorted(flat.items(), key=lambda item: (len(item[0][0]), item[0])):
        nested.setdefault(a, {}).setdefault(b, {})[c] = value
    return nested


def _summary(
    found: Mapping[tuple[str, str, str, str], list[Judgement]],
) -> dict[str, Any]:
    """By method: all at rest, all slides, and slides by scene and speed, controllers together."""

    def pooled(method: str, choose: Callable[[str, str, str], bool]) -> dict[str, Any]:
        own = [
            judgement
            for (group, speed, interval, name), judgements in found.items()
            if name == method and choose(group, speed, interval)
            for judgement in judgements
        ]
        return pooled_judgement(own)

    def slides(scene: str, speed: str) -> Callable[[str, str, str], bool]:
        return lambda group, own, interval: (
            interval == "slide" and group.startswith(scene) and own == speed
        )

    return {
        method: {
            "rest": pooled(method, lambda g, s, interval: interval in ("hold1", "hold2")),
            "slide": pooled(method, lambda g, s, interval: interval == "slide"),
        }
        | {
            f"{scene}_slide_{speed}": pooled(method, slides(scene, speed))
            for scene in ("straight", "ramp")
            for speed in SPEEDS
        }
        for method in METHODS
    }
