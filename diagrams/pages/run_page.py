"""A web page of a run: the robot and the forces at its tool, recorded by a headless Meshcat."""

import logging
from collections.abc import Mapping
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.systems.framework import DiagramBuilder, OutputPort

from wrenchsight.models.files.whole_file import whole_file
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.wrench_arrows import ArrowStyle, WrenchArrows

# The same as in the figures: the truth is black, the estimate blue.
FORCE_ARROWS: dict[str, ArrowStyle] = {
    "force true": ArrowStyle((0.10, 0.10, 0.10)),
    "force estimated": ArrowStyle((0.0, 0.447, 0.698), 0.55, 0.009, 0.021),
}

# rad about the vertical, from the tool's direction to the camera's, clockwise seen from above: to
# the right of one who looks from the base to the tool.
_SIDE_ANGLE = 1.0
_CAMERA_RISE = 0.35  # of the camera, over its horizontal distance
_MIN_DISTANCE_RATIO = 1.2  # of the camera's distance, over the size of arm and path
_MIN_SIZE = 0.5  # m, of arm and path
_TARGET_SHARE = 0.45  # of the way from the base to the tool, where the camera looks
_HALF_VIEW = 0.58  # rad about the camera's axis within which things are shown; Meshcat has 0.65


def _quiet_meshcat() -> Meshcat:
    """Starts Meshcat without its greeting, which names a web address that is of no use here."""
    log = logging.getLogger("drake")
    level = log.level
    log.setLevel(logging.WARNING)
    try:
        return Meshcat(MeshcatParams(show_stats_plot=False))
    finally:
        log.setLevel(level)


def make_meshcat(robot: Robot, p_WE: ArrayLike, view_direction: ArrayLike | None = None) -> Meshcat:
    """Starts Meshcat without a browser, on a white ground, looking at arm and tool from the side.

    Args:
        robot: its base is at W's origin.
        p_WE: (..., 3) m, where the tool will be; one point or more.
        view_direction: (3,) from what the camera looks at to the camera, in W, of any length but 0;
            by default from ahead of the tool and to one side, a little above.
    """
    meshcat = _white_meshcat()
    path = np.asarray(p_WE, dtype=np.float64).reshape(-1, 3)
    middle = 0.5 * (path.min(axis=0) + path.max(axis=0))
    _, p_home = robot.chain.pose(robot.home)  # (3,) m, of E
    # How far E is from the base, at home or on its way: the size of what is to be seen.
    size = max(_MIN_SIZE, float(np.linalg.norm(p_home)), float(np.linalg.norm(path, axis=1).max()))
    # The camera looks between base and tool, at half of `size` over the base.
    target = np.array([_TARGET_SHARE * middle[0], _TARGET_SHARE * middle[1], 0.5 * size])
    direction = _camera_direction(middle, view_direction)
    points = np.vstack([np.zeros(3), p_home, path])  # base, E at home and E on its way
    # Far enough for these; links may stand out beyond them, so not too near in any case.
    distance = max(_MIN_DISTANCE_RATIO * size, _distance_of_view(points - target, direction))
    meshcat.SetCameraPose(target + distance * direction, target)
    return meshcat


def _white_meshcat() -> Meshcat:
    """Starts Meshcat on a white ground, without axes and grid."""
    meshcat = _quiet_meshcat()
    meshcat.SetProperty("/Background", "top_color", [1.0, 1.0, 1.0])
    meshcat.SetProperty("/Background", "bottom_color", [0.93, 0.94, 0.95])
    for object_path in ("/Axes", "/Grid"):
        meshcat.SetProperty(object_path, "visible", False)
    return meshcat


def _camera_direction(tool: Array, view_direction: ArrayLike | None) -> Array:
    """(3,) unit vector from what the camera looks at to the camera, in W.

    Args:
        tool: (3,) m, where the tool is; the camera is ahead of it and to one side by default.
        view_direction: (3,) the direction, of any length but 0; None: the default.
    """
    if view_direction is None:
        azimuth = np.arctan2(tool[1], tool[0]) - _SIDE_ANGLE
        direction = np.array([np.cos(azimuth), np.sin(azimuth), _CAMERA_RISE])
    else:
        direction = np.array(view_direction, dtype=np.float64)
    return np.asarray(direction / np.linalg.norm(direction))


def _distance_of_view(points: Array, direction: Array) -> float:
    """The least distance, m, from which a camera that looks at the origin has points in its view.

    Its view is a cone of half angle _HALF_VIEW: a point may be as far aside as its depth allows.

    Args:
        points: (N, 3) m.
        direction: (3,) unit vector from the origin to the camera.
    """
    towards = points @ direction
    aside = np.linalg.norm(points - towards[:, None] * direction, axis=1)
    return float(np.max(towards + aside / np.tan(_HALF_VIEW)))


def add_wrench_arrows(
    builder: DiagramBuilder,
    meshcat: Meshcat,
    terms: OutputPort,
    wrenches: Mapping[str, OutputPort],
    fps: float,
    metres_per_newton: float,
) -> WrenchArrows:
    """Draws wrenches, named as in FORCE_ARROWS, as arrows at the tool."""
    styles = {name: FORCE_ARROWS[name] for name in wrenches}
    arrows = WrenchArrows(meshcat, styles, fps, metres_per_newton)
    builder.AddNamedSystem("wrench_arrows", arrows)
    builder.Connect(terms, arrows.GetInputPort("terms"))
    for name, port in wrenches.items():
        builder.Connect(port, arrows.GetInputPort(name))
    return arrows


def start_animation(meshcat: Meshcat, fps: float) -> None:
    """Starts the animation: whatever is published to `meshcat` becomes part of it."""
    meshcat.StartRecording(frames_per_second=fps, set_visualizations_while_recording=False)


def write_page(
    meshcat: Meshcat, path: Path, title: str, legend: Mapping[str, ArrayLike] | None = None
) -> None:
    """Ends the animation and writes it as a web page that needs nothing else; whole or not at all.

    Args:
        title: title of the page, shown in it above the legend.
        legend: red, green, blue (and opacity) of each name, in [0, 1]; without it FORCE_ARROWS.

    Raises:
        InputError: the file cannot be written.
    """
    meshcat.StopRecording()
    meshcat.PublishRecording()
    page = meshcat.StaticHtml()
    head, body_end, tail = page.rpartition("</body>")
    if legend is None:
        legend = {name: [*arrow.rgb, arrow.opacity] for name, arrow in FORCE_ARROWS.items()}
    page = head + _legend(title, legend) + body_end + tail
    with whole_file(path) as partial:
        partial.write_text(page, encoding="utf-8")


def _legend(title: str, legend: Mapping[str, ArrayLike]) -> str:
    rows = [f"<b>{escape(title)}</b>"]
    for name, colour in legend.items():
        red, green, blue, opacity = np.append(np.asarray(colour, dtype=np.float64), 1.0)[:4]
        rgba = f"{255 * red:.0f},{255 * green:.0f},{255 * blue:.0f},{opacity:g}"
        mark = f'<span style="color:rgba({rgba})">&#x27A4;</span>'
        rows.append(f"{mark} {escape(name)}")
    style = (
        "position:absolute;left:16px;top:12px;z-index:10;padding:8px 12px;border-radius:4px;"
        "background:rgba(255,255,255,0.85);font:15px/1.5 sans-serif;color:#1a1a1a"
    )
    return f'<div style="{style}">{"<br>".join(rows)}</div>\n'
