"""Pictures of an arm on its way along a path, the path coloured by a posture's measure."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat, Rgba

from wrenchsight.diagrams.pages.arm_picture import ArmPicture, colour_scale, scale_legend
from wrenchsight.diagrams.pages.run_page import make_meshcat, start_animation, write_page
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

_TUBE_RADIUS = 0.006  # m, of the tube along the path
_TUBE_CORNERS = 8  # its corners
# Of the measure, where the scale of colours ends: near a singular posture a measure has no bound,
# and a few samples would take all the colours.
_SCALE_END_QUANTILE = 0.99
# Of the scale's end to its beginning: a measure that is the same everywhere still has a scale, and
# its noise no colours.
_MIN_SCALE_RATIO = 1.01
_PAUSE_TIME = 0.7  # s, between two motions
_MIN_PAUSE_FRAMES = 2  # of a page of few frames a second: a motion that is shown lasts two at least


@dataclass(frozen=True)
class PathMotion:
    """One way to follow a path.

    Attributes:
        name: names it in page and picture; other motions of a page have others.
        q: (N, n) postures, two or more.
        measure: (N,) of each, positive, such as the condition number.
    """

    name: str
    q: Array
    measure: Array


@dataclass(frozen=True)
class TriangleMesh:
    """Something to draw beside the arm: vertices (M, 3) in W, m; triangles (T, 3)."""

    vertices: Array
    triangles: NDArray[np.int32]


def write_path_page(
    robot: Robot,
    motions: Sequence[PathMotion],
    path: Path,
    title: str,
    *,
    label: str = "JCN",
    workpiece: TriangleMesh | None = None,
    seconds: float = 8.0,
    fps: float = 30.0,
) -> None:
    """Writes a web page in which the arm makes the motions one after the other.

    Each motion takes `seconds`. While it lasts, its path is drawn as a tube coloured by the
    measure, on one logarithmic scale for all motions.

    Args:
        robot: the arm.
        motions: one or more, whose names differ.
        path: path of the page, which needs nothing else; written whole or not at all.
        title: stands in the page, before the motions' names.
        label: name of the measure, in the legend.
        workpiece: drawn beside the arm; None: nothing is.
        seconds: length of a motion.
        fps: frames of a second.

    Raises:
        ValueError: a measure that is not positive, or two motions of one name.
        InputError: the file cannot be written.
    """
    _check_motions(motions)
    low, high = _ends_of_scale(motions)
    tips = [robot.chain.pose(motion.q)[1] for motion in motions]  # (N, 3) m, of E in W
    middle = np.mean(np.concatenate(tips), axis=0)
    meshcat = make_meshcat(robot, middle)  # which the page looks at
    picture = ArmPicture(robot, meshcat, fps)
    if workpiece is not None:
        _draw_workpiece(meshcat, workpiece)
    for motion, tip in zip(motions, tips, strict=True):
        _draw_tube(meshcat, _meshcat_path(motion), tip, colour_scale(motion.measure, low, high))
    # From here on each `picture.show` is a frame of the page, at its time in s.
    start_animation(meshcat, fps)
    pause = max(_PAUSE_TIME, _MIN_PAUSE_FRAMES / fps)
    start = 0.0  # s, of a motion in the page's time
    for number, motion in enumerate(motions):
        if number > 0:
            start = start + seconds + pause
            # Meshcat moves the arm evenly from frame to frame. The last posture once more, one
            # frame before the next motion, lets it rest through the pause and then jump.
            picture.show(motions[number - 1].q[-1], start - 1.0 / fps)
        _show_one_path(meshcat, motions, motion, start)  # from then on, until the next one's
        _show_motion(picture, motion, start, seconds, fps)
    names = ", then ".join(motion.name for motion in motions)
    write_page(meshcat, path, f"{title}: {names}", scale_legend(label, low, high))


def _check_motions(motions: Sequence[PathMotion]) -> None:
    """Raises ValueError where a measure has no colour, or two motions would share one tube."""
    # The scale of colours is logarithmic; NaN fails the comparison, too.
    if not all(np.all(motion.measure > 0.0) for motion in motions):
        raise ValueError("path page: a measure must be positive")
    if len({_meshcat_path(motion) for motion in motions}) < len(motions):
        raise ValueError("path page: the names of the motions must differ")


def _ends_of_scale(motions: Sequence[PathMotion]) -> tuple[float, float]:
    """The measures at which the scale of colours begins and ends, for all motions."""
    measures = np.concatenate([motion.measure for motion in motions])
    low = float(np.min(measures))
    high = max(float(np.quantile(measures, _SCALE_END_QUANTILE)), _MIN_SCALE_RATIO * low)
    return low, high


def _show_motion(
    picture: ArmPicture, motion: PathMotion, start: float, seconds: float, fps: float
) -> None:
    """Shows a motion that takes `seconds`, from `start` in the page's time on, s."""
    num_frames = max(2, round(seconds * fps))
    # The rows of q that the frames show: where one is no whole number, a posture between two.
    rows = np.linspace(0.0, len(motion.q) - 1.0, num_frames)
    for frame, row in enumerate(rows.tolist()):
        picture.show(_between(motion.q, row), start + frame / fps)


def _draw_workpiece(meshcat: Meshcat, workpiece: TriangleMesh) -> None:
    meshcat.SetTriangleMesh(
        "workpiece",
        np.ascontiguousarray(workpiece.vertices.T),
        np.ascontiguousarray(workpiece.triangles.T),
        Rgba(0.80, 0.82, 0.85, 1.0),
    )


def _show_one_path(
    meshcat: Meshcat, motions: Sequence[PathMotion], current: PathMotion, time: float
) -> None:
    """Shows the path of one motion, and hides the others, from a time of the recording on, s."""
    for motion in motions:
        meshcat.SetProperty(
            _meshcat_path(motion), "visible", motion is current, time_in_recording=time
        )


def _meshcat_path(motion: PathMotion) -> str:
    """The place of a motion's tube in Meshcat's tree, in which a slash would begin a branch."""
    return f"path/{motion.name.replace('/', ' ')}"


def _between(q: Array, index: float) -> Array:
    """q (N, n) at a fractional index."""
    i = min(int(index), len(q) - 2)
    return np.asarray(q[i] + (index - i) * (q[i + 1] - q[i]))


def _draw_tube(meshcat: Meshcat, meshcat_path: str, points: Array, colours: Array) -> None:
    """A tube of `_TUBE_RADIUS` through points (N, 3), coloured at each (N, 3)."""
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    axis = np.eye(3)[int(np.argmin(np.sum(np.abs(along), axis=0)))]
    first = np.cross(along, axis)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-12)
    second = np.cross(along, first)
    angle = np.linspace(0.0, 2.0 * np.pi, _TUBE_CORNERS, endpoint=False)[:, np.newaxis, np.newaxis]
    # (_TUBE_CORNERS, N, 3)
    rings = points + _TUBE_RADIUS * (np.cos(angle) * first + np.sin(angle) * second)
    index = np.arange(_TUBE_CORNERS * len(points)).reshape(_TUBE_CORNERS, len(points))
    a, b = index[:, :-1], index[:, 1:]
    d, c = np.roll(a, -1, axis=0), np.roll(b, -1, axis=0)
    triangles = np.concatenate(
        [np.stack([a, c, b], axis=-1).reshape(-1, 3), np.stack([a, d, c], axis=-1).reshape(-1, 3)]
    )
    meshcat.SetTriangleColorMesh(
        meshcat_path,
        np.ascontiguousarray(rings.reshape(-1, 3).T),
        np.ascontiguousarray(triangles.T.astype(np.int32)),
        np.ascontiguousarray(np.tile(colours, (_TUBE_CORNERS, 1)).T),
    )
