"""All contact runs read by all methods and judged: the numbers of experiment `ur10e-contact`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_reading import (
    PreparedRun,
    air_refits,
    command_reading,
    interval_reasons,
    judge_interval,
    of_controller,
    plain_law,
    read_article,
    read_by_hand,
    read_gravity,
    read_two_joints,
    read_with,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_runs import (
    CONTACT,
    CONTROLLERS,
    INTERVALS,
    JUDGED,
    SCENES,
)
from wrenchsight.analyses.methods.identify.known_model.specimen_refitting import (
    SpecimenRefit,
    carried_over,
    presliding_of,
    refit_rows,
)
from wrenchsight.analyses.methods.reference_sensor.judged_force import (
    ForceJudgement,
    ForceReading,
    pooled_judgement,
)
from wrenchsight.models.estimation.invalid import InvalidCodes
from wrenchsight.models.estimation.invalid_shares import invalid_pct
from wrenchsight.models.identification.identified_model import IdentifiedModel

METHODS: Final = (
    "no_sensor",
    "command",
    "calibrated",
    "article",
    "by_hand",
    "two_joints",
    "gravity",
    "carried_over",
)
SPEEDS: Final = ("v10", "v25", "v90")
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

    def judged(self, method: str, interval: str) -> ForceJudgement | None:
        """Judges a method over an interval; None where the run lacks it or has no reading there."""
        return judge_interval(self.prepared, self.readings[method], interval)


def read_runs(
    prepared: Sequence[PreparedRun],
    files: Sequence[Path],
    identified: IdentifiedModel,
    progress: Callable[[float], None],
) -> tuple[list[ReadRun], dict[str, SpecimenRefit]]:
    """Fits the friction and reads every run by every method (METHODS).

    Three models differ in where this arm's friction comes from: "command" and "no_sensor", one
    reading under two names, from the motion in the air of all runs of the run's controller,
    "calibrated" from the other ones of these runs with their sensor, "carried_over" from the other
    specimen as it is.

    Args:
        files: of the runs, in the order of `prepared`.
        identified: model of another specimen.
        progress: called with the share done.

    Returns:
        The runs, read; and the fits to the motion in the air, by controller.
    """
    law, torque_sd = plain_law(prepared)
    air_fits = air_refits(prepared, identified)
    carried_model = replace(identified, friction=carried_over(presliding_of(identified)))
    runs = []
    for k, (run, file) in enumerate(zip(prepared, files, strict=True)):
        progress(k / len(prepared))
        controller = run.run.name.controller
        others = [other for other in of_controller(prepared, controller) if other is not run]
        sensor_fit = air_fits[controller]
        if others:  # else there is nothing to calibrate on
            other_rows = [other.sensor_rows for other in others]
            sensor_fit = refit_rows(other_rows, run.robot, identified)
        # The fit's robot has the torque constants that the sensor showed, where it did.
        calibrated_robot = sensor_fit.robot or run.robot
        command = command_reading(run, file, air_fits[controller].model)
        readings = {
            "no_sensor": command,
            "command": command,
            "calibrated": read_with(run, file, calibrated_robot, sensor_fit.model),
            "article": read_article(run, law, torque_sd),
            "by_hand": read_by_hand(run),
            "two_joints": read_two_joints(run),
            "gravity": read_gravity(run),
            "carried_over": read_with(run, file, run.robot, carried_model),
        }
        runs.append(ReadRun(run, readings))
    return runs, air_fits


def contact_metrics(runs: Sequence[ReadRun]) -> dict[str, Any]:
    """Bias, scatter and band by scene, controller, speed, interval and method, and pooled.

    Each judgement of a run counts on several paths of keys; a path's judgements are pooled:

        <scene and controller>, <speed>, <interval or "all">, <method>
        "by_force", <force>, <interval>, <method>
        "summary", <method>, <"slide", "rest", CONTACT, or scene and speed of a slide>
        "settled" or "checked", <"slide" or "rest">, <method>

    "settled": the runs on which the constants were chosen; "checked": the others.
    """
    # `_paths` lists those that a table always has; without a judgement their figures are None.
    judged: dict[tuple[str, ...], list[ForceJudgement]] = {path: [] for path in _paths()}
    for read in runs:
        name = read.prepared.run.name
        half = "settled" if name.stem in SETTLED_ON else "checked"
        for method, interval in product(METHODS, INTERVALS):
            judgement = read.judged(method, interval)
            if judgement is None:
                continue
            paths: list[tuple[str, ...]] = [
                (name.group, name.speed_key, interval, method),
                ("by_force", f"f{name.force}", interval, method),
            ]
            if interval in JUDGED:
                kind = "slide" if interval == "slide" else "rest"
                paths += [("summary", method, kind), (half, kind, method)]
                paths.append((name.group, name.speed_key, "all", method))
            if interval == CONTACT:
                paths.append(("summary", method, CONTACT))
            if interval == "slide":
                paths.append(("summary", method, f"{name.scene}_slide_{name.speed_key}"))
            for path in paths:
                judged.setdefault(path, []).append(judgement)
    metrics: dict[str, Any] = {}
    for path, judgements in judged.items():
        node = metrics  # nested dictionaries, a level a key
        for key in path[:-1]:
            node = node.setdefault(key, {})
        node[path[-1]] = pooled_judgement(judgements)
    return metrics


def invalid_by_kind(runs: Sequence[ReadRun], method: str = "command") -> dict[str, Any]:
    """Percent of a method's averages of 0.1 s that are not valid, by reason, at rest and sliding.

    Returns:
        By kind, "rest" and "slide".
    """
    codes: dict[str, list[InvalidCodes]] = {"rest": [], "slide": []}
    for read, interval in product(runs, JUDGED):
        kind = "slide" if interval == "slide" else "rest"
        codes[kind].append(interval_reasons(read.prepared, read.readings[method], interval))
    return {kind: invalid_pct(np.concatenate(parts)) for kind, parts in codes.items()}


def _paths() -> list[tuple[str, ...]]:
    """Paths of the metrics that exist also where no run is of their kind."""
    kinds = product(SCENES, CONTROLLERS, SPEEDS, (*INTERVALS, "all"), METHODS)
    slides = [f"{scene}_slide_{speed}" for scene in ("straight", "ramp") for speed in SPEEDS]
    return [
        *((f"{scene}_{controller}", *keys) for scene, controller, *keys in kinds),
        *(
            ("summary", method, kind)
            for method in METHODS
            for kind in ("rest", "slide", CONTACT, *slides)
        ),
        *product(("settled", "checked"), ("rest", "slide"), METHODS),
    ]
