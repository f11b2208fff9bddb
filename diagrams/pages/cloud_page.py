"""A picture of points in space, coloured by a measure, with the arm among them."""

from pathlib import Path

import numpy as np
from pydrake.perception import BaseField, Fields, PointCloud

from wrenchsight.diagrams.pages.arm_picture import ArmPicture, colour_scale, scale_legend
from wrenchsight.diagrams.pages.run_page import make_meshcat, start_animation, write_page
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

_POINT_SIZE = 0.007  # m


def write_cloud_page(
    robot: Robot,
    points: Array,
    measure: Array,
    path: Path,
    title: str,
    *,
    low: float,
    high: float,
) -> None:
    """Writes a web page with points (N, 3) in W, m, coloured by `measure` (N,) on [low, high].

    Raises:
        InputError: the file cannot be written.
    """
    meshcat = make_meshcat(robot, np.array([0.5, -0.5, 0.6]))
    cloud = PointCloud(len(points), Fields(BaseField.kXYZs | BaseField.kRGBs))
    cloud.mutable_xyzs()[:] = points.T
    cloud.mutable_rgbs()[:] = np.round(255.0 * colour_scale(measure, low, high)).T.astype(np.uint8)
    meshcat.SetObject("cloud", cloud, _POINT_SIZE)
    picture = ArmPicture(robot, meshcat)
    start_animation(meshcat, 30.0)
    picture.show(robot.home)
    write_page(meshcat, path, title, scale_legend("JCN", low, high))
