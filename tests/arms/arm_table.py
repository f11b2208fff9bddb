"""`python -m arm_table --work out/arms --page docs/arms.md`: arms from URDF to `estimate`.

Each arm goes through the commands' own functions, with one small excitation for all: a draft of
its robot.yaml, `excite`, a log of the simulated arm with its assumed friction and noise,
`identify`, and `estimate` on a second motion. What is found is kept in WORK, an arm a file, so that
a run that was stopped goes on; remove a file to have its arm again.
"""

import argparse
import json
import re
import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv
import pydrake
from package_arms import section_of
from package_meshes import PackageMeshes

import wrenchsight.analyses  # noqa: F401  (chooses the number of BLAS threads)
from wrenchsight.analyses.methods.estimate.estimation import estimate_log
from wrenchsight.analyses.methods.excite.excitation import ExcitationResult, excite_robot
from wrenchsight.analyses.methods.excite.excitation_config import ExcitationConfig
from wrenchsight.analyses.methods.identify.identification import identify_logs
from wrenchsight.analyses.methods.identify.identification_config import IdentifySettings
from wrenchsight.analyses.methods.robot.robot_draft import draft_robot
from wrenchsight.analyses.methods.simulate.simulated_logs import simulate_excitation
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

EXCITATION = ExcitationConfig(num_starts=2, iterations=8, time_step=0.004)
_CHECKED = 0.02  # s between the postures that are held against the package's meshes
_BAND = 1.96
_NONE_VALID = "no reading is valid: "


@dataclass(frozen=True)
class Arm:
    """An arm of the table.

    Attributes:
        source: wheel (example-robot-data), drake or bundled.
        file: below the source's folder; of a bundled arm its name.
        base, flange: where the draft needs them.
        asked_for: limits of the motion that a message of `excite` asks for, by name.
    """

    name: str
    source: str
    file: str
    base: str | None = None
    flange: str | None = None
    asked_for: Mapping[str, Any] = field(default_factory=dict)

    @property
    def path(self) -> Path:
        return FOLDERS[self.source] / self.file


def _wheel() -> Path:
    wheel = metadata.distribution("example-robot-data")
    return Path(str(wheel.locate_file("cmeel.prefix/share/example-robot-data/robots")))


FOLDERS = {
    "wheel": _wheel(),
    "drake": Path(pydrake.__file__).parent / "share/drake/examples",
    "bundled": Path(),
}
ARMS = (
    *(Arm(name, "bundled", name) for name in ("sts_sre4_600", "ur10e", "ur5e", "panda")),
    *(
        Arm(f"{name}", "wheel", f"ur_description/urdf/{name}.urdf")
        for name in (
            "ur3_robot", "ur3_gripper", "ur5_robot", "ur5_gripper", "ur10_robot",
            "ur10_joint_limited_robot",
        )
    ),
    Arm("panda with its hand", "wheel", "panda_description/urdf/panda.urdf"),
    Arm("panda, simple shapes", "wheel", "panda_description/urdf/panda_collision.urdf"),
    Arm("kinova j2s6s200", "wheel", "kinova_description/robots/kinova.urdf"),
    Arm("xarm7", "wheel", "xarm_description/urdf/xarm7.urdf"),
    Arm("z1", "wheel", "z1_description/urdf/z1.urdf"),
    Arm("so100", "wheel", "so_arm_description/urdf/so100.urdf"),
    Arm("so101", "wheel", "so_arm_description/urdf/so101.urdf"),
    Arm("talos, its left arm alone", "wheel", "talos_data/robots/talos_left_arm.urdf"),
    Arm("talos, left arm", "wheel", "talos_data/robots/talos_full_v2.urdf",
        "torso_2_link", "gripper_left_base_link"),
    Arm("tiago without hand", "wheel", "tiago_description/robots/tiago_no_hand.urdf"),
    Arm("tiago", "wheel", "tiago_description/robots/tiago.urdf"),
    Arm("tiago dual, left arm", "wheel", "tiago_description/robots/tiago_dual.urdf",
        "torso_lift_link", "arm_left_tool_link"),
    Arm("tiago pro, left arm", "wheel", "tiago_pro_description/robots/tiago_pro.urdf",
        "torso_lift_link", "arm_left_tool_link"),
    Arm("anymal with a kinova", "wheel", "anymal_b_simple_description/robots/anymal-kinova.urdf",
        None, "j2s6s200_end_effector"),
    Arm("b1 with a z1", "wheel", "b1_description/urdf/b1-z1.urdf"),
    Arm("baxter, left arm", "wheel", "baxter_description/urdf/baxter.urdf",
        None, "left_hand_link", {"torque_share": 1.0}),
    Arm("pr2, right arm", "wheel", "pr2_description/urdf/pr2.urdf",
        "torso_lift_link", "r_gripper_palm_link"),
    Arm("romeo, left arm", "wheel", "romeo_description/urdf/romeo.urdf", "torso", "l_wrist"),
    Arm("icub, left arm", "wheel", "icub_description/robots/icub.urdf", "chest", "l_hand"),
    Arm("centauro, arm 1", "wheel", "centauro_description/urdf/centauro.urdf", None, "arm1_8"),
    Arm("alex, left arm", "wheel", "alex_description/urdf/alex_nub_hands.urdf", None, "leftNub"),
    Arm("g1, left arm", "wheel", "g1_description/urdf/g1_29dof_rev_1_0.urdf",
        "torso_link", "left_rubber_hand"),
    Arm("simple humanoid, left arm", "wheel",
        "simple_humanoid_description/urdf/simple_humanoid.urdf", "torso", "l_wrist"),
    Arm("hextilt, flying arm 5", "wheel", "hextilt_description/urdf/hextilt_flying_arm_5.urdf"),
    Arm("borinot, flying arm 2", "wheel", "borinot_description/urdf/borinot_flying_arm_2.urdf",
        asked_for={"no_floor": True}),
    Arm("finger edu", "wheel", "finger_edu_description/robots/finger_edu.urdf",
        None, "finger_tip_link"),
    Arm("two joints", "wheel", "asr_twodof_description/urdf/TwoDofs.urdf"),
    Arm("acrobot", "drake", "acrobot/Acrobot.urdf", asked_for={"no_floor": True}),
)  # fmt: skip


def run_arm(arm: Arm, folder: Path, excitation: ExcitationConfig = EXCITATION) -> dict[str, Any]:
    """The row of an arm: figures, or the sentence of what refused it.

    Args:
        folder: to work in; made anew.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    row: dict[str, Any] = {"arm": arm.name, "source": arm.source, "stage": "robot"}
    limits = replace(excitation.limits, **arm.asked_for)
    excitation = replace(excitation, limits=limits)
    try:
        robot, name = _robot(arm, folder)
        row |= {"joints": robot.num_joints, "locked": len(robot.config.locked_joints)}
        row["stage"] = "excite"
        results = excite_robot(name, folder / "excite", excitation, True, False)
        closest = [r.closest.distance for r in results if r.closest is not None]
        row["closest_mm"] = 1e3 * min(closest) if closest else None
        row["excitation_condition"] = results[0].condition_number
        row["notes"] = sorted({w for result in results for w in result.warnings})
        row["stage"] = "collisions"
        row |= _collisions(arm, robot, results)
        row["stage"] = "identify"
        logs = []
        for k, result in enumerate(results):
            logs.append(folder / f"log_{k}.parquet")
            log = simulate_excitation(robot, result.trajectory, 1, k)
            write_recording(log.recording, logs[k])
        log_names = [str(log) for log in logs]
        settings = IdentifySettings(robot=name, logs=log_names[:1], validate=log_names[1:])
        identification = identify_logs(settings, folder / "identify")
        row["condition"] = identification.base.condition_number
        row["stage"] = "estimate"
        read = estimate_log(logs[1], name, folder / "identify/model.yaml", folder / "estimate")
        row["valid_pct"] = 100.0 * read.valid_share
        row["band_pct"] = _band(read.table)
        row["doubts"] = list(read.warnings)
        row["stage"] = "through"
    except InputError as error:
        row["refused"] = re.sub(r"(?<!\S)/\S*/([^/\s:]+)", r"\1", str(error))
    except Exception as error:
        row["refused"] = f"{type(error).__name__}: {error}"
        row["defect"] = True
    return row


def _robot(arm: Arm, folder: Path) -> tuple[Robot, str]:
    if arm.source == "bundled":
        return Robot.load(arm.file), arm.file
    path = folder / "robot.yaml"
    robot, *_ = draft_robot(arm.path, path, arm.base, arm.flange)
    return robot, str(path)


def _collisions(
    arm: Arm, robot: Robot, results: tuple[ExcitationResult, ...]
) -> dict[str, dict[str, int]]:
    """Over all samples of the motions: at how many which pair of the package's meshes overlaps.

    Apart those of links whose distance `excite` says that it does not keep.
    """
    try:
        meshes = PackageMeshes(robot, None if arm.source == "bundled" else arm.path)
    except ValueError:  # pinocchio does not read every URDF that Drake does
        return {"collisions": {}, "said": {"not read by pinocchio": -1}}
    motions = [result.trajectory for result in results]
    q = [motion.sample(np.arange(0.0, motion.period, _CHECKED))[0] for motion in motions]
    notes = [note for result in results for note in result.warnings if "is not checked" in note]
    overlap_counts: dict[str, dict[str, int]] = {"collisions": {}, "said": {}}
    for pair, count in meshes.collisions(np.concatenate(q)).items():
        links = [shape.rpartition("_")[0] for shape in pair.split(" and ")]
        is_reported = any(all(link in note for link in links) for note in notes)
        overlap_counts["said" if is_reported else "collisions"][pair] = count
    return overlap_counts


def _band(table: Path) -> float | None:
    """Share in % of the valid forces within their 95 % band of the truth, which is zero."""
    rows = pyarrow.csv.read_csv(table)
    valid = rows.column("valid").to_numpy() > 0
    if not valid.any():
        return None
    inside = [
        np.abs(rows.column(axis).to_numpy()[valid])
        <= _BAND * rows.column(f"sd_{axis}").to_numpy()[valid]
        for axis in ("fx", "fy", "fz")
    ]
    return float(100.0 * np.mean(inside))


def is_wrong(row: dict[str, Any]) -> bool:
    """Whether a row claims what is not so, or a defect made it."""
    hit = bool(row.get("collisions")) and row.get("closest_mm") is not None
    return bool(row.get("defect")) or hit


def page(rows: list[dict[str, Any]]) -> str:
    """docs/arms.md."""
    through = [row for row in rows if row["stage"] == "through"]
    wrong = [row["arm"] for row in rows if is_wrong(row)]
    lines = [
        "# Arms",
        "",
        "<!-- `make arms` writes this page. -->",
        "",
        "This page lists the arms of example-robot-data "
        f"{metadata.version('example-robot-data')}, the arms among the examples of Drake "
        f"{metadata.version('drake')}, and the bundled ones.",
        "Each goes from URDF to `estimate`: `robot`, `excite` with 2 starts and 8 iterations, a "
        "simulated log of 10 s and two stops, `identify`, and `estimate` on a second motion.",
        "The log has assumed friction, noise and resolution. Nothing touches the arm in the second "
        f"motion. {len(through)} of {len(rows)} go through; wrong: {', '.join(wrong) or 'none'}.",
        *_what_was_asked_for(through),
        "The default settings of `excite` give a better conditioned motion.",
        "",
        "- **condition**: condition number of the base parameters' regressor in `identify`",
        "- **valid**: share of the readings of the second motion that are valid. The motion rests "
        "for 3 s of its 14, in two stops and at its ends, where stiction can hide a force: hardly "
        "any of these 22 % is valid.",
        "  Rightly so: of 30 simulated pushes with a quarter of the payload's weight in such stops "
        "(ur3_robot, z1, ur10e, b1 with a z1, panda with simple shapes; 3 axes) 18 were read wrong "
        "by more than the limit for stiction, up to 3.2 times it, the Panda's 6 by less.",
        "- **band**: share of the valid forces whose 95 % band contains the true force, 0 N",
        "- **closest**: least distance of any two shapes in both motions, as `excite` certifies "
        "it; – where it states none",
        "- **overlaps**: samples, every 20 ms of both motions, in which pinocchio and coal find "
        "overlapping meshes of the package. Pairs that always overlap are left out.",
        "  Brackets hold the overlaps of pairs that `excite` reports as not checked, since they "
        "overlap at home.",
        "",
        "| arm | from | joints | condition | valid [%] | band [%] | closest [mm] | overlaps |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in through:
        closest = "–" if row["closest_mm"] is None else f"{row['closest_mm']:.0f}"
        band = "–" if row["band_pct"] is None else f"{row['band_pct']:.0f}"
        hits = str(max(row["collisions"].values(), default=0))
        if row["said"]:
            most = max(row["said"].values())
            hits = f"{hits} ({most})" if most > 0 else "not read"
        cells = [row["arm"], row["source"], row["joints"], f"{row['condition']:.3g}",
                 f"{row['valid_pct']:.0f}", band, closest, hits]  # fmt: skip
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    silent = [row for row in through if not row["valid_pct"]]
    if silent:
        lines += ["", "Where no reading is valid, `estimate` says why:", ""]
        lines += [f"- {row['arm']}: {_why_none_is_valid(row)}" for row in silent]
    refused = [row for row in rows if row["stage"] != "through"]
    if refused:
        lines += ["", "## Refused", "", "| arm | from | at | why |", "|---|---|---|---|"]
        for row in refused:
            why = row["refused"].replace("|", "/").replace("<", "&lt;")
            lines.append(f"| {row['arm']} | {row['source']} | `{row['stage']}` | {why} |")
    return "\n".join(lines) + "\n"


def _what_was_asked_for(through: list[dict[str, Any]]) -> list[str]:
    """One line on the arms that went through with what a message of `excite` asked for, if any."""
    names = {row["arm"] for row in through}
    texts = [
        f"{arm.name} ({', '.join(f'{name}: {value}' for name, value in arm.asked_for.items())})"
        for arm in ARMS
        if arm.asked_for and arm.name in names
    ]
    if not texts:
        return []
    return [f"Some of these have what a message of `excite` asks for: {', '.join(texts)}."]


def _why_none_is_valid(row: dict[str, Any]) -> str:
    notes = [str(note) for note in row["doubts"]]
    reason = next((note for note in notes if note.startswith(_NONE_VALID)), "only shares by reason")
    return reason.removeprefix(_NONE_VALID)


def main() -> int:
    """Runs what is not there yet, and writes the page; 1 where an arm is wrong."""
    parser = argparse.ArgumentParser(prog="arm_table", description=__doc__)
    parser.add_argument("--work", type=Path, default=Path("out/arms"))
    parser.add_argument("--page", type=Path, default=Path("docs/arms.md"))
    parser.add_argument("--only", default="", help="arms whose name holds this; no page")
    options = parser.parse_args()
    rows = []
    chosen = [arm for arm in ARMS if options.only in arm.name]
    for k, arm in enumerate(chosen):
        stem = "".join(c if c.isalnum() else "_" for c in arm.name)
        row_path = options.work / f"{stem}.json"
        if row_path.is_file() and not options.only:
            row = json.loads(row_path.read_text())
        else:
            began = time.monotonic()
            row = run_arm(arm, options.work / stem)
            row["seconds"] = round(time.monotonic() - began, 1)
            row_path.write_text(json.dumps(row, indent=1))
            shutil.rmtree(options.work / stem)
        rows.append(row)
        outcome = row["stage"] if row["stage"] == "through" else f"{row['stage']}: {row['refused']}"
        hits = f", overlaps {row['collisions']}" if row.get("collisions") else ""
        print(
            f"{k + 1}/{len(chosen)} {arm.name}, {row.get('seconds')} s: {outcome}{hits}", flush=True
        )
    if not options.only:
        more = section_of(options.page.read_text(encoding="utf-8"))
        options.page.write_text(page(rows) + more, encoding="utf-8")
    return int(any(map(is_wrong, rows)))


if __name__ == "__main__":
    raise SystemExit(main())
