"""Conversion of published files to those that an experiment reads.

`ur10e_pushes`: the rows are the source's, with a header and times from 0. Two signals are added:
the torque `tau_des - K i` beyond the controller's target, and the times of the hand's pushes.

`neura_lara8_urdf`: meshes, the measuring tool and its tip are dropped, right angles are exact,
numbers have nine decimals, and the welded base has an inertia. The robot.yaml beside it is ours.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from wrenchsight.models.numerics.arrays import Array

_NUM_JOINTS: Final = 6
# N m/A, the exact tau_des / i_des of a joint that stands still.
_TORQUE_PER_AMPERE: Final = np.array([11.976, 11.976, 9.839, 10.763, 10.763, 11.333])
_SIGNALS: Final = ("q", "v", "i", "i_des", "tau_des", "tau_res")
# s from the first row. A push begins where a joint leaves its mean by 6 6 4 1.2 1.2 0.5 N m, and
# ends where the change is below 30 % of the largest.
_PUSH_TIMES: Final = ((1.932, 2.704), (4.694, 5.744), (8.414, 9.358), (11.89, 13.1))
_PUSHES_FORMAT: Final = Path(__file__).with_name("ur10e_pushes_format.yaml")
_SETTLING_TIME, _PUSH_MARGIN = 1.5, 0.2  # s after a push, before the next: not `still`


def convert_pushes(folder: Path) -> dict[str, str]:
    """The files of `ur10e_pushes`, by name, of the published recording in a folder.

    Raises:
        OSError, ValueError: the published file is not there, or not as it was published.
    """
    rows = np.loadtxt(folder / "ur-20_01_22-push_pose_1.csv", delimiter=",", ndmin=2)
    t = np.round(rows[:, 0] - rows[0, 0], 6)
    tau_desired, current = rows[:, 25:31], rows[:, 13:19]
    push = np.zeros(len(t), int)
    is_still = np.ones(len(t), bool)
    for number, (begin, end) in enumerate(_PUSH_TIMES, start=1):
        push[(begin <= t) & (t <= end)] = number
        is_still[(begin - _PUSH_MARGIN < t) & (t < end + _SETTLING_TIME)] = False
    columns = np.column_stack(
        [t, rows[:, 1:31], tau_desired - _TORQUE_PER_AMPERE * current, push, is_still]
    )
    header = ["t", *(f"{key}{j + 1}" for key in _SIGNALS for j in range(_NUM_JOINTS))]
    spans = [(1, number, *span) for number, span in enumerate(_PUSH_TIMES, start=1)]
    return {
        "push_pose_1.csv": _csv([*header, "push", "still"], columns),
        "pushes.csv": _csv(["pose", "push", "t_start", "t_end"], np.array(spans)),
        "recording.yaml": _PUSHES_FORMAT.read_text(encoding="utf-8"),
    }


def _csv(header: list[str], rows: Array) -> str:
    lines = [",".join(header), *(",".join(f"{value:.7g}" for value in row) for row in rows)]
    return "\n".join(lines) + "\n"


# Names of joints and links: robot.yaml states the tool that the arm carries.
_DROPPED_NAMES: Final = ("measurement_tool_joint", "measurement_tool", "tcp_joint", "tcp")
_BASE_INERTIA: Final = {"ixx": "0.01", "iyy": "0.01", "izz": "0.01"}  # kg m^2, of no effect
_LARA8_ROBOT: Final = Path(__file__).with_name("lara8_robot.yaml")


def convert_lara8(folder: Path) -> dict[str, str]:
    """The files of `neura_lara8_urdf`, by name, of the published description in a folder.

    Raises:
        OSError, ET.ParseError: the published file is not there, or not as it was published.
    """
    root = ET.parse(folder / "lara8.urdf").getroot()
    for element in list(root):
        if element.tag == "material" or element.get("name") in _DROPPED_NAMES:
            root.remove(element)
    for link in root.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
        if link.get("name") == "link0":
            for inertia in link.iter("inertia"):
                inertia.attrib.update(_BASE_INERTIA)
    for element in root.iter():
        for key, value in element.attrib.items():
            if key in ("rpy", "xyz", "value"):  # numbers, with a machine's last digits
                element.set(key, " ".join(_tidy(float(word)) for word in value.split()))
            elif value == "lara8_flange":  # in its link's name and its joint's child
                element.set(key, "flange")
    ET.indent(root)
    robot = _LARA8_ROBOT.read_text(encoding="utf-8")
    return {"robot.urdf": ET.tostring(root, encoding="unicode") + "\n", "robot.yaml": robot}


def _tidy(value: float) -> str:
    """A number with nine decimals; a right angle exactly."""
    turns = value / (math.pi / 2)
    if abs(turns) > 0.5 and abs(turns - round(turns)) < 1e-9:
        return repr(round(turns) * math.pi / 2)
    return repr(round(value, 9) + 0.0)


CONVERSIONS: Final[dict[str, Callable[[Path], dict[str, str]]]] = {
    "ur10e_pushes": convert_pushes,
    "neura_lara8_urdf": convert_lara8,
}
"""By set: from the folder of the published files to texts by the names of new files in it."""
