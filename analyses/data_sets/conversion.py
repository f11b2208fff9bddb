"""Files that an experiment reads, made of published ones: a header, times from 0, what is derived.

`ur10e_pushes`: the rows are the source's. Added are the torque that the controller's target does
not explain, `tau_des - K i`, and where the hand pushes.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from wrenchsight.models.arrays import Array

_NUM_JOINTS: Final = 6
# N m/A, the exact tau_des / i_des of a joint that stands still.
_K: Final = np.array([11.976, 11.976, 9.839, 10.763, 10.763, 11.333])
_SIGNALS: Final = ("q", "v", "i", "i_des", "tau_des", "tau_res")
# s from the first row. A push begins where a joint leaves its mean by 6 6 4 1.2 1.2 0.5 N m, and
# ends where the change is below 30 % of the largest.
_PUSHES: Final = ((1.932, 2.704), (4.694, 5.744), (8.414, 9.358), (11.89, 13.1))
_SETTLING, _MARGIN = 1.5, 0.2  # s after a push, before the next: not `still`


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
    for number, (begin, end) in enumerate(_PUSHES, start=1):
        push[(begin <= t) & (t <= end)] = number
        is_still[(begin - _MARGIN < t) & (t < end + _SETTLING)] = False
    columns = np.column_stack([t, rows[:, 1:31], tau_desired - _K * current, push, is_still])
    header = ["t", *(f"{key}{j + 1}" for key in _SIGNALS for j in range(_NUM_JOINTS))]
    spans = [(1, number, *span) for number, span in enumerate(_PUSHES, start=1)]
    return {
        "push_pose_1.csv": _csv([*header, "push", "still"], columns),
        "pushes.csv": _csv(["pose", "push", "t_start", "t_end"], np.array(spans)),
    }


def _csv(header: list[str], rows: Array) -> str:
    lines = [",".join(header), *(",".join(f"{value:.7g}" for value in row) for row in rows)]
    return "\n".join(lines) + "\n"


CONVERSIONS: Final[dict[str, Callable[[Path], dict[str, str]]]] = {"ur10e_pushes": convert_pushes}
"""By set: from the folder of the published files to texts by the names of new files in it."""
