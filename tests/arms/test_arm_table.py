"""A part of `make arms`: one arm with fingers from URDF to `estimate`, and one that is refused."""

import json
from pathlib import Path

import pytest
from arm_table import ARMS, Arm, is_wrong, page, run_arm

from wrenchsight.analyses.methods.excite.excitation_config import ExcitationConfig

_DOCS = Path(__file__).parents[2] / "docs" / "arms.md"
_QUICK = ExcitationConfig(num_starts=1, iterations=2)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_an_arm_of_the_wheel_goes_through(tmp_path: Path) -> None:
    (arm,) = (arm for arm in ARMS if arm.name == "ur3_gripper")
    row = run_arm(arm, tmp_path / "arm", _QUICK)
    assert row["stage"] == "through", row
    assert row["joints"] == 6
    assert row["collisions"] == {}
    assert row["closest_mm"] > 0.0
    assert row["valid_pct"] > 50.0
    assert 88.0 < row["band_pct"] <= 100.0
    assert not is_wrong(row)
    text = page([json.loads(json.dumps(row))])
    assert "1 of 1 go through; wrong: none" in text
    assert "| ur3_gripper | wheel | 6 |" in text


def test_a_refused_arm_is_a_sentence(tmp_path: Path) -> None:
    urdf = tmp_path / "arm.urdf"
    urdf.write_text('<robot name="none"><link name="base"/></robot>')
    row = run_arm(Arm("none", "wheel", str(urdf)), tmp_path / "arm")
    assert row["stage"] == "robot"
    assert not row.get("defect")
    why = row["refused"].replace("<", "&lt;")
    assert f"| none | wheel | `robot` | {why} |" in page([row])


def test_an_arm_without_a_valid_reading_has_its_reason() -> None:
    row = {
        "arm": "a", "source": "wheel", "stage": "through", "joints": 2, "condition": 5.0,
        "valid_pct": 0.0, "band_pct": None, "closest_mm": None, "collisions": {}, "said": {},
        "doubts": ["fast", "no reading is valid: the force's sd is 16 N"],
    }  # fmt: skip
    assert "\n- a: the force's sd is 16 N\n" in page([row])
    assert "says why" not in page([row | {"valid_pct": 50.0, "band_pct": 95.0}])
    assert "asks for" not in page([row])
    assert "asks for: acrobot (no_floor: True)." in page([row | {"arm": "acrobot"}])


def test_an_unreported_collision_is_wrong() -> None:
    row = {"arm": "a", "stage": "through", "closest_mm": 20.0, "collisions": {"a and b": 3}}
    assert is_wrong(row)
    assert not is_wrong(row | {"closest_mm": None})  # no clearance was claimed
    assert is_wrong({"arm": "a", "stage": "identify", "refused": "KeyError: 1", "defect": True})


def test_the_page_holds_every_arm() -> None:
    text = _DOCS.read_text(encoding="utf-8")
    for arm in ARMS:
        assert f"| {arm.name} | {arm.source} |" in text
    assert "wrong: none" in text
