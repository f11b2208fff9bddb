"""All contact runs read by all methods and judged: the numbers of experiment `ur10e-contact`."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from analyses.methods.reading.contact_friction import (
    AIR_JOINTS,
    NUM_JOINTS,
    air_fit,
    known_friction,
    plain_friction,
    sensor_fit,
)
from analyses.methods.reading.contact_reading import (
    BLOCK,
    PreparedRun,
    averaged,
    block_mean,
    prepare,
    read_article,
    read_by_hand,
    read_ours,
    read_two_joints,
)
from analyses.methods.reading.contact_runs import (
    CONTROLLERS,
    INTERVALS,
    JUDGED,
    SCENES,
    find_runs,
    read_run,
    tool_chain,
)
from analyses.methods.sensors.judged_force import ForceReading, Judgement, pooled_judgement
from models.arrays import Array
from models.calibration.specimen_friction import SpecimenFit
from models.contact.contact_force import ContactForceConfig, FrictionErrorConfig
from models.contact.torque_blocks import torque_blocks
from models.friction.presliding_friction import PreslidingFriction
from models.robot.robot import Robot

METHODS: Final = ("no_sensor", "calibrated", "article", "by_hand", "two_joints", "carried_over")
SPEEDS: Final = ("v10", "v25", "v90")
FOUND: Final = np.isin(np.arange(NUM_JOINTS), AIR_JOINTS)
_TORQUE_CONSTANT_UP = 0.05
_UNKNOWN_SCATTER = 2.0  # N m, of a joint that does not move in the air, for the article's band

# The runs on which every constant of `contact_force` and `contact_friction` was settled; all
# others only check them.
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


def prepare_runs(data: Path, robot: Robot, progress: Callable[[float], None]) -> list[PreparedRun]:
    """Reads every run below `data`.

    Raises:
        InputError: there is none, or one is damaged.
    """
    chains = {controller: tool_chain(robot, controller) for controller in CONTROLLERS}
    files, prepared = find_runs(data), []
    for k, path in enumerate(files):
        progress(k / len(files))
        run = read_run(path)
        prepared.append(prepare(run, chains[run.name.controller], torque_constants(robot)))
    return prepared


def torque_constants(robot: Robot) -> Array:
    """(6,) N m/A with the drives' signs."""
    return np.asarray(robot.torque_per_ampere * robot.current_sign)


def with_gain(run: PreparedRun, gain: Array) -> PreparedRun:
    """The run with torque constants that are larger by the share gain (6,)."""
    return replace(run, terms=replace(run.terms, tau_J=run.terms.tau_J * (1.0 + gain)))


def read_runs(
    prepared: Sequence[PreparedRun], robot: Robot, progress: Callable[[float], None]
) -> ContactStudy:
    """Fits the friction and reads every run by every method."""
    known, K = known_friction(), torque_constants(robot)
    rows = [run.rows for run in prepared]
    air, plain = air_fit(rows, known), air_fit(rows, plain_friction())
    torque_sd = np.where(np.isfinite(plain.scatter), plain.scatter, _UNKNOWN_SCATTER)
    runs = []
    for k, run in enumerate(prepared):
        progress(k / len(prepared))
        others = [other for i, other in enumerate(rows) if i != k]
        calibrated = sensor_fit(others, known) if others else air
        readings = {
            "no_sensor": read_ours(run, air.law, FOUND),
            "calibrated": read_ours(with_gain(run, calibrated.gain), calibrated.law),
            "article": read_article(run, plain.law, torque_sd),
            "by_hand": read_by_hand(run, K),
            "two_joints": read_two_joints(run, K),
            "carried_over": read_ours(run, known, np.zeros(NUM_JOINTS, bool)),
        }
        runs.append(ReadRun(run, readings))
    return ContactStudy(tuple(runs), air, plain)


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


# What the errors are made of ----------------------------------------------------------------------


def error_parts(
    study: ContactStudy, robot: Robot, progress: Callable[[float], None]
) -> dict[str, Any]:
    """RMSE without a sensor as it is, and with one piece of knowledge left out or wrong at a time.

    Every second run, in the order of their names, is read for it.
    """
    runs = [read.prepared for read in study.runs][::2]
    air = study.air.law
    unloaded = replace(known_friction(), load=np.zeros(NUM_JOINTS))
    flat = air_fit([read.prepared.rows for read in study.runs], unloaded).law
    flat = replace(flat, load=np.zeros(NUM_JOINTS))
    narrow = ContactForceConfig(across_sd=0.01, standing_across_sd=0.01, moment_sd=0.001)
    afresh = ContactForceConfig(friction=FrictionErrorConfig(kept=0.0))
    plain_rotors = robot.reflected_inertia

    def rotors(run: PreparedRun) -> PreparedRun:
        chain = run.chain.with_inertial_parameters(run.chain.inertial_parameters, plain_rotors)
        return prepare(run.run, chain, torque_constants(robot))

    def constant(run: PreparedRun) -> PreparedRun:
        return with_gain(run, np.full(NUM_JOINTS, _TORQUE_CONSTANT_UP))

    def same(run: PreparedRun) -> PreparedRun:
        return run

    cases: dict[str, tuple[Callable[[PreparedRun], PreparedRun], PreslidingFriction, Any]] = {
        "as_it_is": (same, air, None),
        "friction_of_another_robot": (same, known_friction(), None),
        "friction_without_load": (same, flat, None),
        "rotors_of_the_urdf": (rotors, air, None),
        "force_along_the_tool_alone": (same, air, narrow),
        "no_friction_kept_at_rest": (same, air, afresh),
        "torque_constant_5_pct_up": (constant, air, None),
    }
    parts = {}
    for k, (name, (change, law, config)) in enumerate(cases.items()):
        progress(k / len(cases))
        parts[name] = _rmse_by_kind(runs, change, law, config)
    return parts


def _rmse_by_kind(
    runs: Sequence[PreparedRun],
    change: Callable[[PreparedRun], PreparedRun],
    law: PreslidingFriction,
    config: ContactForceConfig | None,
) -> dict[str, float | None]:
    errors: dict[str, list[float]] = defaultdict(list)
    for run in runs:
        changed = change(run)
        reading = read_ours(changed, law, FOUND, config)
        for interval in JUDGED:
            windows = run.windows(interval)
            if not len(windows):
                continue
            judged = Judgement.of(averaged(reading, windows), run.truth[windows].mean(axis=1))
            kind = f"{run.run.name.scene}_slide" if interval == "slide" else "rest"
            if judged is not None:
                errors[kind].append(judged.rmse)
    kinds = ("rest", "straight_slide", "ramp_slide")
    return {f"{k}_rmse_n": float(np.mean(errors[k])) if errors[k] else None for k in kinds}


def torque_residuals(study: ContactStudy) -> dict[str, Any]:
    """What is left of each joint's torque when the sensor's force is taken off, N m.

    At rest the friction is all of it: model without friction. In slides it is what the law misses,
    the mean over a run (`bias`) and around it (`sd`), away from the path's corners. Root mean
    squares over the runs; `sliding_level` is the mean of the law there, without viscous friction.
    """
    rest, bias, scatter, level = [], [], [], []
    for read in study.runs:
        run = read.prepared
        blocks = torque_blocks(run.terms, study.air.law, BLOCK)
        error = blocks.tau_ext - blocks.H[:, :, 0] * run.truth[:, None]
        corners = block_mean(run.run.corners.astype(float))
        for interval in JUDGED:
            rows = run.windows(interval).ravel()
            rows = rows[blocks.known[rows] & (corners[rows] == 0.0)]
            if not len(rows):
                continue
            if interval == "slide":
                bias.append(error[rows].mean(axis=0))
                scatter.append(error[rows].std(axis=0))
                level.append(blocks.level[rows].mean(axis=0))
            else:
                rest.append((error - blocks.friction)[rows].mean(axis=0))

    def rms(values: list[Array]) -> Array | None:
        return np.sqrt(np.mean(np.square(values), axis=0)) if values else None

    return {
        "rest_nm": rms(rest),
        "slide_bias_nm": rms(bias),
        "slide_sd_nm": rms(scatter),
        "sliding_level_nm": np.mean(level, axis=0) if level else None,
    }
