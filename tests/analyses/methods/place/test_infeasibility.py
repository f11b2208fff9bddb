"""What a placement lacks, in words; the whole sentence is tested with `place`."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wrenchsight.analyses.methods.place.infeasibility import _shortfalls
from wrenchsight.models.planning.placement.placements import Placement, PlacementBounds
from wrenchsight.models.robot.robot import Robot


@pytest.mark.parametrize(
    ("slides", "beyond_limit", "beyond_step"),
    [(True, "100 mm", "200 mm"), (False, "5.7 degrees", "11.5 degrees")],
)
def test_a_joint_lacks_angle_or_length(
    sts: Robot, slides: bool, beyond_limit: str, beyond_step: str
) -> None:
    """The first joint is 0.1 beyond its limit and steps by 0.2 beyond the largest step."""
    q = np.zeros((2, sts.num_joints))
    q[1, 0] = 1.1
    placement = Placement(q, np.array([1.0, 0.0, 0.0]), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    bounds = PlacementBounds(
        q_lower=np.full(sts.num_joints, -1.0),
        q_upper=np.full(sts.num_joints, 1.0),
        p_lower=np.zeros(3),
        p_upper=np.zeros(3),
        max_joint_step=0.9,
    )
    chain = replace(sts.chain, prismatic=slides & (np.arange(sts.num_joints) == 0))
    program: Any = SimpleNamespace(
        robot=SimpleNamespace(chain=chain),
        bounds=bounds,
        path_length=0.1,
        num_segments=1,
        cell=None,
    )
    end: Any = SimpleNamespace(placement=placement)
    lacks = _shortfalls(program, end)
    assert f"joint limits by {beyond_limit}" in lacks
    assert f"max_joint_step_deg by {beyond_step}" in lacks
