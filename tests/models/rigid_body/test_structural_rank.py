"""Arms that can move their tool in fewer directions than they have joints."""

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.planning.motion.posture_cost import check_joints
from wrenchsight.models.rigid_body.structural_rank import parallel_columns, structural_rank

COLUMN = ("prismatic", "0 0 1", "0 0 0.2")
ARM = [
    ("revolute", "0 0 1", "0 0 0.3"),
    ("revolute", "0 1 0", "0 0 0"),
    ("revolute", "0 1 0", "0 0 0.4"),
    ("revolute", "0 0 1", "0 0 0.35"),
    ("revolute", "0 1 0", "0 0 0"),
    ("revolute", "0 0 1", "0.05 0 0"),
]


def test_bundled_arms_can_do_everything(bundled_arm):
    assert structural_rank(bundled_arm.chain) == 6
    assert parallel_columns(bundled_arm.chain) == ()
    check_joints(bundled_arm.chain)


def test_a_column_below_an_arm_is_welcome(serial_robot):
    check_joints(serial_robot([COLUMN, *ARM]).chain)


def test_two_columns_in_the_place_of_a_joint_are_refused_by_name(serial_robot):
    chain = serial_robot([COLUMN, COLUMN, *ARM[:4]]).chain
    assert parallel_columns(chain) == ("j0", "j1")
    rng = np.random.default_rng(1)
    ranks = [np.linalg.matrix_rank(chain.jacobian(q)) for q in rng.normal(size=(20, 6))]
    assert structural_rank(chain) == max(ranks) < 6
    with pytest.raises(InputError, match="j0 and j1 push along one line"):
        check_joints(chain)


def test_axes_that_meet_in_one_point_are_refused_without_a_name(serial_robot):
    wrist = [(kind, axis, "0 0 0") for kind, axis, _ in ARM]
    with pytest.raises(InputError, match="3 of six directions in every posture;"):
        check_joints(serial_robot(wrist, tool_frame={"xyz": [0.0, 0.0, 0.0]}).chain)
