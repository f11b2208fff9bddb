"""Shared results: computed once, the same for all, and only inside a study."""

import subprocess
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.analyses.study import shared_results
from wrenchsight.analyses.study.shared_results import digest, shared, sharing_in


@dataclass(frozen=True)
class Thing:
    name: str
    values: np.ndarray

    @cached_property
    def total(self) -> float:
        return float(self.values.sum())


def _counter(result):
    calls = []

    def compute():
        calls.append(1)
        return result

    return calls, compute


def test_inside_a_study_it_is_computed_once_per_arguments(tmp_path):
    calls, compute = _counter(np.arange(3.0))
    for arguments in ((1,), (1,)):
        shared("f", arguments, compute)
    assert len(calls) == 2  # outside, every call computes
    with sharing_in(tmp_path):
        with pytest.raises(ZeroDivisionError):
            shared("f", (1,), lambda: 1 / 0)  # is not kept
        for arguments in ((1,), (1,), (2,)):
            np.testing.assert_array_equal(shared("f", arguments, compute), np.arange(3.0))
        shared("g", (1,), compute)
    assert len(calls) == 5


def test_the_first_caller_gets_the_same_layout_as_the_others(tmp_path):
    """A view becomes contiguous in the file: sums over it could differ in the last digit."""
    strided = np.arange(12.0).reshape(3, 4)[:, ::2]
    with sharing_in(tmp_path):
        first, second = (shared("f", (), lambda: strided) for _ in range(2))
    assert first.strides == second.strides != strided.strides


def test_who_asks_meanwhile_waits_for_the_other_process(tmp_path):
    program = """
import sys, time
from pathlib import Path
from wrenchsight.analyses.study.shared_results import shared, sharing_in
folder = Path(sys.argv[1])
def compute():
    with (folder / "calls").open("a") as file:
        file.write("x")
    time.sleep(1.0)
    return 5
with sharing_in(folder):
    print(shared("f", (), compute))
"""
    root = Path(shared_results.__file__).resolve().parents[2]
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", program, str(tmp_path)], cwd=root, stdout=subprocess.PIPE
        )
        for _ in range(2)
    ]
    assert [p.communicate()[0].strip() for p in processes] == [b"5", b"5"]
    assert (tmp_path / "calls").read_text() == "x"


# ---- digests ----


def test_equal_values_have_equal_digests():
    one, other = Thing("a", np.arange(3.0)), Thing("a", np.arange(3.0))
    assert one.total == 3.0  # cached on one of them only
    assert digest(one) == digest(other)
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    assert digest(np.arange(6.0).reshape(2, 3).T) == digest(np.arange(6.0).reshape(2, 3).T.copy())


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1, 1.0),
        (1, True),
        ((1, 2), (12,)),
        (("ab",), ("a", "b")),
        ([1], (1,)),
        (np.zeros(2), np.zeros((2, 1))),
        (np.zeros(2), np.zeros(2, dtype=np.int64)),
        (0.1, 0.1 + 2e-17),
        (Thing("a", np.zeros(2)), Thing("b", np.zeros(2))),
        (Thing("a", np.zeros(2)), Thing("a", np.array([0.0, 1e-300]))),
    ],
)
def test_unlike_values_have_unlike_digests(one, other):
    assert one is not other
    assert (digest(one) == digest(other)) is (type(one) is float and one == other)


def test_a_robot_s_digest_is_its_own_in_every_process(sts, ur10e):
    program = (
        "from wrenchsight.analyses.study.shared_results import digest; "
        "from wrenchsight.models.robot.robot import Robot; "
        "r = Robot.load('ur10e'); r.chain; print(digest(r))"
    )
    root = Path(shared_results.__file__).resolve().parents[2]
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=root
    )
    assert result.stdout.strip() == digest(ur10e)
    assert digest(ur10e) != digest(sts)
