"""The surroundings of a placed path as one mesh to draw."""

import numpy as np

from wrenchsight.diagrams.pages.path_page import TriangleMesh
from wrenchsight.diagrams.placement.placement_cell import obstacle_corners, workpiece_corners
from wrenchsight.models.planning.placement.placement_task import ClearanceConfig
from wrenchsight.models.planning.placement.placements import Placement


def cell_picture(clearance: ClearanceConfig | None, placement: Placement) -> TriangleMesh | None:
    """Workpiece and obstacles of a placement; None where there are none."""
    if clearance is None:
        return None
    boxes = []
    if clearance.workpiece is not None:
        boxes.append(workpiece_corners(clearance, placement))
    boxes += [obstacle_corners(obstacle) for obstacle in clearance.obstacles]
    if not boxes:
        return None
    faces = np.array(
        [
            [0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6], [0, 4, 5], [0, 5, 1],
            [1, 5, 6], [1, 6, 2], [2, 6, 7], [2, 7, 3], [3, 7, 4], [3, 4, 0],
        ],
        dtype=np.int32,
    )  # fmt: skip
    triangles = np.concatenate([faces + 8 * i for i in range(len(boxes))]).astype(np.int32)
    return TriangleMesh(np.concatenate(boxes), triangles)
