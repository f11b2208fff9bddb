"""Names of joints as drivers, pendants and several arms in one log write them."""

from pathlib import Path

import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.layouts.joint_names import matched_joints, of_matching
from wrenchsight.models.recordings.log_words import log_words

_UR = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint",
       "wrist_2_joint", "wrist_3_joint"]  # fmt: skip
_PANDA = [f"panda_joint{j}" for j in range(1, 8)]
_LOG = Path("log.mcap")


@pytest.mark.parametrize(
    ("robot", "log", "how"),
    [
        (_UR, _UR, ""),
        (_UR, [f"robot1_{name}" for name in _UR], 'apart from "robot1_"'),
        (_UR, [f"{name}_left" for name in _UR], 'apart from "_left"'),
        (_UR, ["Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 2", "Wrist 3"], "teach pendant"),
        (_UR, ["base", "shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3"], "teach pendant"),
        (_UR, ["Basis", "Schulter", "Ellbogen", "Handgelenk 1", "Handgelenk 2", "Handgelenk 3"],
         "teach pendant"),
        (_UR, ["base", "hombro", "codo", "muneca_1", "muneca_2", "muneca_3"], "teach pendant"),
        (_UR, list("SLURBT"), "by the letters of the axes"),
        (_PANDA, list("SLEURBT"), "by the letters of the axes"),
        (_UR, [f"J{j}" for j in range(1, 7)], "by their numbers"),
        (_UR, [f"axis_{j}" for j in range(6)], "by their numbers"),
        (_PANDA, [f"fr3_joint{j}" for j in range(1, 8)], "by their numbers"),
        (_PANDA, [f"joint{j}" for j in range(1, 8)], 'apart from the robot\'s "panda_"'),
    ],
)  # fmt: skip
def test_names_are_matched_in_the_robots_order(robot: list[str], log: list[str], how: str) -> None:
    shuffled = sorted(["finger_joint", *log], key=lambda name: name[::-1])
    match = matched_joints(shuffled, robot, _LOG)
    assert match is not None
    assert list(match.joints) == log
    assert how in match.how
    assert bool(match.how) == bool(how)


@pytest.mark.parametrize(
    "log",
    [
        [f"wrist_{j}" for j in range(1, 7)],  # six wrists are no arm
        [f"joint{j}" for j in range(1, 8)],  # seven joints for six
        ["a", "b", "c", "d", "e", "f"],
        [f"robot1_{name}" for name in _UR[:5]] + ["robot2_wrist_3_joint"],
    ],
)
def test_other_names_do_not_match(log: list[str]) -> None:
    assert matched_joints(log, _UR, _LOG) is None


def test_two_arms_of_one_log_are_chosen_by_their_prefix() -> None:
    log = [f"{side}_{name}" for side in ("left", "right") for name in _UR]
    with pytest.raises(InputError, match=r'"left_", "right_".*--log-format joint-prefix=left_'):
        matched_joints(log, _UR, _LOG)
    match = matched_joints(log, _UR, _LOG, log_words("joint-prefix=right_"))
    assert match is not None
    assert match.joints == tuple(f"right_{name}" for name in _UR)


def test_joints_without_names_need_a_stated_order() -> None:
    numbers = [str(j) for j in range(1, 7)]
    with pytest.raises(InputError, match=r"/js: the messages name no.*joints-in-robot-order"):
        matched_joints(numbers, _UR, _LOG, source="/js")
    match = matched_joints(numbers, _UR, _LOG, log_words("joints-in-robot-order"))
    assert match is not None
    assert match.joints == tuple(numbers)
    with pytest.raises(InputError, match=r'holds 7 for 6.*"TOPIC/\{1..6\}/position"'):
        matched_joints([*numbers, "7"], _UR, _LOG)


def test_a_topic_in_doubt_does_not_hide_one_that_matches() -> None:
    sources = {"/hand": [str(j) for j in range(1, 7)], "/arm": _UR}
    assert list(of_matching(sources, _UR, _LOG)) == ["/arm"]
    with pytest.raises(InputError, match="name no joints"):
        of_matching({"/hand": sources["/hand"]}, _UR, _LOG)
