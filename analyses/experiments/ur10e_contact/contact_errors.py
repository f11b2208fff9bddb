"""The causes of the contact runs' errors, each tried by itself.

    wrong or left out   RMSE with one piece of knowledge missing or off by as much as it may be
    known               RMSE if the torque of one joint were that of the sensor's force, all its
                        friction, gravity and torque constant known
    residuals           each joint's torque less that of the sensor's force

The sensor itself reads 0.0 N before contact and at most 0.45 N after it: no cause.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.experiments.ur10e_contact.contact_friction import (
    NUM_JOINTS,
    air_fit,
    known_friction,
)
from wrenchsight.analyses.experiments.ur10e_contact.contact_reading import (
    BLOCK,
    PreparedRun,
    averaged,
    block_mean,
    prepare,
)
from wrenchsight.analyses.experiments.ur10e_contact.contact_runs import JUDGED
from wrenchsight.analyses.experiments.ur10e_contact.contact_study import (
    FOUND,
    ContactStudy,
    torque_constants,
    with_gain,
)
from wrenchsight.analyses.methods.sensors.judged_force import ForceReading, Judgement
from wrenchsight.models.arrays import Array
from wrenchsight.models.contact.contact_force import (
    ContactForceConfig,
    FrictionErrorConfig,
    read_contact_force,
)
from wrenchsight.models.contact.torque_blocks import torque_blocks
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.robot.robot import Robot

KINDS: Final = ("rest", "straight_slide", "ramp_slide")
AS_IT_IS: Final = "as_it_is"
_TORQUE_CONSTANT_UP = 0.05
_MASSES_UP = 0.02  # the published gravity differs by as much from the controller's
_POSITIONS_OFF = 1.5e-3  # rad, joints 2 to 4: how well the rebuilt positions are known
_STRIDE = 3  # runs


@dataclass(frozen=True, eq=False)
class _Case:
    """How a run is read for one cause."""

    law: PreslidingFriction
    change: Callable[[PreparedRun], PreparedRun] = lambda run: run
    config: ContactForceConfig | None = None
    known: int | None = None  # joint whose torque is the sensor's


def error_parts(
    study: ContactStudy, robot: Robot, progress: Callable[[float], None]
) -> dict[str, Any]:
    """RMSE without a sensor by kind of interval, as it is, and with one thing changed at a time.

    Every third run, in the order of their names, is read for it.
    """
    runs = [read.prepared for read in study.runs][::_STRIDE]
    air = study.air.law
    unloaded = replace(known_friction(), load=np.zeros(NUM_JOINTS))
    flat = air_fit([read.prepared.rows for read in study.runs], unloaded).law
    flat = replace(flat, load=np.zeros(NUM_JOINTS))
    narrow = ContactForceConfig(across_sd=0.01, standing_across_sd=0.01, moment_sd=0.001)
    point = ContactForceConfig(moment_sd=0.001)
    afresh = ContactForceConfig(friction=FrictionErrorConfig(kept=0.0))
    plain_rotors = robot.reflected_inertia
    K = torque_constants(robot)

    def rotors(run: PreparedRun) -> PreparedRun:
        chain = run.chain.with_inertial_parameters(run.chain.inertial_parameters, plain_rotors)
        return prepare(run.run, chain, K)

    def masses(run: PreparedRun) -> PreparedRun:
        chain = run.chain.with_inertial_parameters(
            (1.0 + _MASSES_UP) * run.chain.inertial_parameters, run.chain.reflected_inertia
        )
        return prepare(run.run, chain, K)

    def positions(run: PreparedRun) -> PreparedRun:
        moved = replace(run.run, q=run.run.q + _POSITIONS_OFF * np.array([0, 1, 1, 1, 0, 0]))
        return prepare(moved, run.chain, K)

    def constant(run: PreparedRun) -> PreparedRun:
        return with_gain(run, np.full(NUM_JOINTS, _TORQUE_CONSTANT_UP))

    cases = {
        AS_IT_IS: _Case(air),
        "friction_of_another_robot": _Case(known_friction()),
        "friction_without_load": _Case(flat),
        "rotors_of_the_urdf": _Case(air, rotors),
        "masses_2_pct_up": _Case(air, masses),
        "torque_constant_5_pct_up": _Case(air, constant),
        "positions_1p5_mrad_off": _Case(air, positions),
        "force_along_the_tool_alone": _Case(air, config=narrow),
        "contact_at_a_point": _Case(air, config=point),
        "no_friction_kept_at_rest": _Case(air, config=afresh),
    }
    cases |= {f"joint_{j + 1}_known": _Case(air, known=j) for j in range(NUM_JOINTS)}
    parts = {}
    for k, (name, case) in enumerate(cases.items()):
        progress(k / len(cases))
        parts[name] = _rmse_by_kind(runs, case)
    return parts


def largest_first(parts: dict[str, Any], kind: str, known: bool) -> list[tuple[str, float]]:
    """Causes, each with its change of the RMSE of a kind, N, the largest first.

    Args:
        parts: of `error_parts`.
        kind: of KINDS.
        known: what knowing a joint would take off, or what missing or wrong knowledge adds.
    """
    key = f"{kind}_rmse_n"
    own = parts[AS_IT_IS][key]
    if own is None:
        return []
    sign = -1.0 if known else 1.0
    found = [
        (name, sign * (part[key] - own))
        for name, part in parts.items()
        if name != AS_IT_IS and name.endswith("_known") == known
    ]
    return sorted(found, key=lambda item: -item[1])


def _rmse_by_kind(runs: Sequence[PreparedRun], case: _Case) -> dict[str, float | None]:
    errors: dict[str, list[float]] = defaultdict(list)
    for run in runs:
        changed = case.change(run)
        blocks = torque_blocks(changed.terms, case.law, BLOCK)
        if case.known is not None:
            tau_ext = blocks.tau_ext.copy()
            tau_ext[:, case.known] = blocks.H[:, case.known, 0] * run.truth
            blocks = replace(blocks, tau_ext=tau_ext)
        force = read_contact_force(blocks, case.config, FOUND)
        reading = ForceReading(force.normal, force.normal_sd)
        for interval in JUDGED:
            windows = run.windows(interval)
            if not len(windows):
                continue
            judged = Judgement.of(averaged(reading, windows), run.truth[windows].mean(axis=1))
            kind = f"{run.run.name.scene}_slide" if interval == "slide" else "rest"
            if judged is not None:
                errors[kind].append(judged.rmse)
    return {f"{k}_rmse_n": float(np.mean(errors[k])) if errors[k] else None for k in KINDS}


def torque_residuals(study: ContactStudy) -> dict[str, Any]:
    """Each joint's torque less that of the sensor's force, N m.

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
