"""The table of other packages' arms: shares, refusals, and its place on the page."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from package_arms import (
    ARMS,
    SECTION,
    PackageArm,
    _answered,
    inside,
    run_arm,
    section,
    section_of,
    with_section,
)

_PAGE = Path(__file__).parents[2] / "docs" / "arms.md"
_ROW = {
    "arm": "ur3e",
    "package": "airo_models",
    "refused": "",
    "joints": 6,
    "condition": 5.93,
    "free_contacts": 0,
    "valid_pct": 84.2,
    "inside_pct": 96.7,
    "causal_inside_pct": 93.1,
}


def test_the_share_inside_counts_valid_forces_at_the_times_of_the_wrenches(tmp_path: Path) -> None:
    t = np.arange(0.0, 1.0, 0.1)
    truth = np.stack([10.0 * t, -10.0 * t, 0.0 * t])
    error = np.zeros((3, 10))
    error[0, :5] = 2.1  # beyond 1.96 sd, on one axis
    valid = np.ones(10)
    valid[0] = 0.0
    wrench = np.column_stack([t, *(truth + error), *np.ones((3, 10)), valid])
    header = "t,fx,fy,fz,sd_fx,sd_fy,sd_fz,valid"
    np.savetxt(tmp_path / "wrench.csv", wrench, delimiter=",", header=header, comments="")
    # The log has another rate.
    log_t = np.array([0.0, 1.0])
    log = np.column_stack([log_t, 10.0 * log_t, -10.0 * log_t, 0.0 * log_t])
    header = "t,wrench_true.1,wrench_true.2,wrench_true.3"
    np.savetxt(tmp_path / "log.csv", log, delimiter=",", header=header, comments="")
    share = inside(tmp_path / "wrench.csv", tmp_path / "log.csv")
    assert share == pytest.approx(100.0 * (1.0 - 4.0 / 27.0))


def test_a_refused_arm_is_the_line_of_its_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["pytest"])
    row = run_arm(PackageArm("none", "nothing", "none.urdf"), tmp_path, tmp_path / "work")
    assert row["command"] == "robot"
    assert row["refused"].startswith("none.urdf: no such file")
    text = section([_ROW, row], {"nothing": "1.0", "airo_models": "0.0.12"})
    assert "1 of 2 reach a wrench" in text
    assert "| ur3e | airo_models |  | 6 | 5.93 | 0 | 84 | 97 | 93 |" in text
    assert f"| none | nothing | `robot` | {row['refused']} |  |  |  |" in text


def test_the_answer_to_a_message_has_a_row_of_its_own() -> None:
    draft = (
        "drives:\n"
        "  - {joint: joint_a5, rotor_inertia: 0.0}  # FILL IN\n"
        "  - {joint: joint_a6, rotor_inertia: 0.0, current_noise_sd: 12}  # FILL IN\n"
    )
    key = "rotor_inertia"
    arm = PackageArm("kr210", "", "", answer=(("joint_a6", key, 20.0), ("joint_a5", "effort", 7)))
    text = _answered(draft, arm)
    assert "{joint: joint_a6, rotor_inertia: 20, current_noise_sd: 12}  # FILL IN" in text
    assert "effort: 7" in text
    drives = yaml.safe_load(text)["drives"]
    assert drives[0] == {"joint": "joint_a5", "rotor_inertia": 0.0, "effort": 7}
    refused = _ROW | {"arm": "kr210", "package": "p", "command": "simulate", "refused": "open"}
    text = section([_ROW, refused | {"after": _ROW}], {"airo_models": "0.0.12"})
    assert "1 of 2 reach a wrench, and 1 more with what a message asks for" in text
    assert "| kr210 | p | `simulate` | open | rotor_inertia of joint_a6: 20 | 84 | 97 |" in text


def test_the_section_is_the_last_of_the_page() -> None:
    page = with_section("# Arms\n\nfirst\n", f"{SECTION}\n\nold\n")
    assert section_of("# Arms\n") == ""
    assert section_of(page) == f"\n{SECTION}\n\nold\n"
    assert with_section(page, f"{SECTION}\n\nnew\n") == f"# Arms\n\nfirst\n\n{SECTION}\n\nnew\n"


def test_the_page_names_arms_of_the_list_alone() -> None:
    names = {arm.name for arm in ARMS}
    rows = [line for line in section_of(_PAGE.read_text(encoding="utf-8")).splitlines()
            if line.startswith("| ") and not line.startswith(("| arm ", "| refused "))]  # fmt: skip
    assert {row.split(" | ")[0].removeprefix("| ") for row in rows} <= names
