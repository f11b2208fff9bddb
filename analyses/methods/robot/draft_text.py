"""The text of a drafted robot.yaml, with marks where a description has no number."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wrenchsight.analyses.methods.robot.draft_assumptions import (
    FRICTION_SHARE,
    ROTOR_ACCELERATION,
    Assumed,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.arm_structure import DescribedJoint
from wrenchsight.models.robot.robot_config import DEFAULT_GRAVITY

FILL_IN = "FILL IN"
"""Marks, in the comments of a draft, a number that the URDF does not hold."""

# sd and step of the current, as torque, of what a joint carries
_NOISE_SHARE = 0.003
_STEP_SHARE = 0.0005
# rad/s (m/s) where Stribeck's rise has fallen, and where viscous friction equals Coulomb's
_STRIBECK_SPEED, _STRIBECK_SLIDE_SPEED = 0.1, 0.02
_VISCOUS_SPEED, _VISCOUS_SLIDE_SPEED = 1.0, 0.2
_STICTION_RATIO = 1.3  # of stiction to Coulomb's friction
_ENCODER_STEP = 1e-5  # rad (m)
_ENCODER_SPEED_SD = 1e-4  # rad/s (m/s)


@dataclass(frozen=True)
class DraftText:
    """The contents of a URDF that a robot.yaml needs, and the file to write.

    Attributes:
        out: the robot.yaml.
        urdf: beside it, or elsewhere.
        origin: origin of the URDF: its own name, or that of the xacro.
        name: name of the robot.
        base, flange: links.
        arm: its joints.
        locked: moving joints that are not the arm's.
        gravity: (3,) m/s^2 in W.
        mends_inertias: whether possible inertias take the place of those that no body has.
    """

    out: Path
    urdf: Path
    origin: str
    name: str
    base: str
    flange: str
    arm: list[DescribedJoint]
    locked: list[DescribedJoint]
    gravity: Array
    mends_inertias: bool = False

    def text(self, home: Array, floor: float | None, assumed: Assumed) -> str:
        """The robot.yaml.

        Numbers that no URDF holds stand in the lines marked FILL_IN: of the tool's frame and the
        payload, and a line a drive.

        Args:
            home: (n,) rad or m.
            floor: m, its height in W; None: there is none.
            assumed: what no URDF holds. A joint that carries nothing gets no noise; an effort of 0
                leaves the URDF's limit.
        """
        path = self.urdf.resolve()
        if path.is_relative_to(self.out.resolve().parent):
            path = path.relative_to(self.out.resolve().parent)
        lines = [
            f"# Drafted from {self.origin}. What the URDF does not hold is marked {FILL_IN}: such",
            "# numbers only make the file load. docs/your-robot.md says where they are found.",
            f"name: {_quoted(self.name)}",
            f"urdf: {_quoted(str(path))}",
            f"base_link: {_quoted(self.base)}  # W is its frame",
            f"flange: {_quoted(self.flange)}  # the link that carries the tool",
            "tool_frame: {xyz: [0, 0, 0], rpy: [0, 0, 0]}"
            f"  # {FILL_IN}: E in the flange, m and rad",
            "# tool: {mass: kg, com: [x, y, z], inertia: [ixx, iyy, izz, ixy, ixz, iyz]}  "
            "# what is mounted there, in axes of the flange",
            self._gravity_line(),
            f"floor: {floor + 0.0:.4g}  # m, its height in W; null where there is none"  # not -0
            if floor is not None
            else "floor: null  # none is known near the arm; else the floor's height in W, m",
            f"payload: {assumed.payload:g}  # {FILL_IN}: kg, rated (data sheet)",
            f"home: [{', '.join(f'{value:g}' for value in home)}]"
            "  # rad or m: free of contact, far from singular",
        ]
        if self.mends_inertias:
            lines.append(
                "possible_inertias: true  # the nearest possible ones, where the URDF has inertias "
                "that no body has; correct them there (CAD)"
            )
        if self.locked:
            lines.append("locked_joints:  # moving joints that are not the arm's, rad or m")
            lines += [f"  {_quoted(joint.name)}: {joint.middle:g}" for joint in self.locked]
        lines += [
            "",
            "# torque_per_ampere, N m/A on the joint side: motor torque constant times gear ratio",
            "# (data sheet). 1 where the log holds joint torque in N m instead of current.",
            "# rotor_inertia, kg m^2 on the joint side: data sheet, times the gear ratio squared.",
            *_rotor_lines(self.arm, assumed),
            "drives:",
        ]
        lines += [_drive_line(joint, assumed, j) for j, joint in enumerate(self.arm)]
        if assumed.carried.any():
            lines += _truth_lines(self.arm, assumed)
        return "\n".join(lines) + "\n"

    def _gravity_line(self) -> str:
        if np.allclose(self.gravity, [0.0, 0.0, -DEFAULT_GRAVITY], atol=1e-9):
            return (
                f"gravity: [0, 0, -{DEFAULT_GRAVITY:g}]  # in W; another vector where the base "
                "hangs or is tilted"
            )
        vector = ", ".join(f"{value:.5g}" for value in np.round(self.gravity, 5) + 0.0)
        return f"gravity: [{vector}]  # in W, as the URDF mounts the base"


def _rotor_lines(arm: list[DescribedJoint], assumed: Assumed) -> list[str]:
    """A comment on rotors that are assumed; none where the description states all of them."""
    is_stated = [joint.rotor_inertia > 0.0 for joint in arm]
    if not (assumed.rotor_inertia > 0.0)[np.logical_not(is_stated)].any():
        return []
    return [
        "# What the description does not state of it is assumed, as of drives whose effort limit",
        f"# turns the rotor alone at {ROTOR_ACCELERATION:g} rad/s^2.",
    ]


def _drive_line(joint: DescribedJoint, assumed: Assumed, j: int) -> str:
    """The line of the drive of joint j, its limits in the comment."""
    carried, effort = float(assumed.carried[j]), float(assumed.effort[j])
    fields = f"joint: {_quoted(joint.name)}, torque_per_ampere: 1.0, "
    fields += f"rotor_inertia: {float(assumed.rotor_inertia[j]):.2g}, rotor_inertia_side: joint"
    if carried > 0.0:
        noise, step = _NOISE_SHARE * carried, _STEP_SHARE * carried
        fields += f", current_noise_sd: {noise:.2g}, current_resolution: {step:.2g}"
    comment = FILL_IN
    if effort > 0.0:
        fields += f", effort_limit: {effort:g}"
        comment += (
            f", also effort_limit: weight and inertia need {assumed.needed[j]:.3g}"
            if joint.effort > 0.0
            else ", also effort_limit, for which the file wrote 0"
            if joint.effort == 0.0
            else ", also effort_limit, which the file lacks"
        )
    return f"  - {{{fields}}}  # {comment}; limits {_limits(joint)}"


def _truth_lines(arm: list[DescribedJoint], assumed: Assumed) -> list[str]:
    """Plain friction and resolution of the simulated arm, which only `simulate` reads.

    Where the description gives links no mass, theirs, too.
    """
    carried = assumed.carried
    slides = np.array([joint.kind == "prismatic" for joint in arm])
    coulomb = FRICTION_SHARE * carried
    rows = {
        "stiction": _STICTION_RATIO * coulomb,
        "coulomb": coulomb,
        "stribeck_velocity": np.where(slides, _STRIBECK_SLIDE_SPEED, _STRIBECK_SPEED),
        "viscous": coulomb / np.where(slides, _VISCOUS_SLIDE_SPEED, _VISCOUS_SPEED),
    }
    encoder = {
        "resolution": np.full(len(arm), _ENCODER_STEP),
        "velocity_noise_sd": np.full(len(arm), _ENCODER_SPEED_SD),
    }

    def listed(values: Array) -> str:
        return "[" + ", ".join(f"{value:.2g}" for value in values) + "]"

    masses = []
    if assumed.link_masses.any():
        masses = [f"  link_masses: {listed(assumed.link_masses)}  # kg, of links without a mass"]
    friction_lines = [f"    {name}: {listed(values)}" for name, values in rows.items()]
    encoder_lines = [f"      {name}: {listed(values)}" for name, values in encoder.items()]
    return [
        "",
        "# What only simulations read, all of it assumed: friction of a twentieth of what a joint",
        "# carries, as the noise and steps of the currents above are parts of it. N m, rad, s.",
        "simulated_truth:",
        *masses,
        "  friction:",
        *friction_lines,
        "  mechanisms:",
        "    encoder:",
        *encoder_lines,
    ]


def _limits(joint: DescribedJoint) -> str:
    unit = "m" if joint.kind == "prismatic" else "rad"
    travel = f"{joint.lower:.4g} to {joint.upper:.4g} {unit}"
    if joint.kind == "continuous":
        travel = "none"
    speed = ", speed not stated"
    if joint.velocity > 0.0:
        speed = f", {joint.velocity:g} {unit}/s"
    elif joint.velocity == 0.0:
        speed = ", speed 0 in the file: taken for none"
    force = "N" if unit == "m" else "N m"
    return travel + speed + (f", {joint.effort:g} {force}" if joint.effort > 0.0 else "")


def _quoted(text: str) -> str:
    plain = text.replace("_", "").replace("/", "").replace(".", "").replace("-", "")
    return text if plain.isalnum() and not plain.isdigit() else '"' + text.replace('"', '\\"') + '"'


def marked_keys(text: str) -> tuple[str, ...]:
    """The keys of a draft that are marked to be filled in, each once."""
    marked = [
        line for line in text.splitlines() if FILL_IN in line and ":" in line.partition("#")[0]
    ]
    keys = [_key_of(line) for line in marked]
    if any("effort_limit:" in line for line in marked):
        keys.append("effort_limit")
    return tuple(dict.fromkeys(keys))


def _key_of(line: str) -> str:
    head = line.partition("#")[0]
    if "torque_per_ampere" in head or "rotor_inertia" in head:
        return "drives"
    return head.partition(":")[0].strip(" -")
