"""Compiled kernels live exactly as long as the code that they were compiled from."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core.errors import NumbaError

from wrenchsight.models.numerics import kernel as kernel_module
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import NEW_ARRAYS, NO_NEW_ARRAYS, kernel, kernel_stamp

CHAIN = """
from wrenchsight.scale import FACTOR, UNUSED
def inner(x):
    return x * FACTOR
def outer(x: float) -> float:
    \"\"\"Words.\"\"\"
    return inner(x) + 1
def apart(x):
    return x
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(kernel_module, "_PACKAGE", tmp_path)
    (tmp_path / "scale.py").write_text("FACTOR = 2\nUNUSED = 3\n")
    (tmp_path / "chain.py").write_text(CHAIN)
    return tmp_path


def _stamps(package: Path) -> tuple[str, str]:
    kernel_module._definitions.cache_clear()
    return kernel_stamp(package / "chain.py", "outer"), kernel_stamp(package / "chain.py", "apart")


@pytest.mark.parametrize(
    "file, before, after, outer_changes, apart_changes",
    [
        ("chain.py", "Words", "Other words", False, False),
        ("chain.py", "x: float", "x: int", False, False),
        ("chain.py", "x) + 1", "x) + 2", True, False),
        ("chain.py", "x * FACTOR", "x / FACTOR", True, False),
        ("chain.py", "    return x\n", "    return -x\n", False, True),
        ("scale.py", "FACTOR = 2", "FACTOR = 5", True, False),
        ("scale.py", "UNUSED = 3", "UNUSED = 5", False, False),
    ],
)
def test_a_stamp_depends_on_all_that_a_kernel_uses(
    package: Path, file: str, before: str, after: str, outer_changes: bool, apart_changes: bool
) -> None:
    outer, apart = _stamps(package)
    text = (package / file).read_text()
    assert before in text
    (package / file).write_text(text.replace(before, after))
    changed_outer, changed_apart = _stamps(package)
    assert (changed_outer != outer) is outer_changes
    assert (changed_apart != apart) is apart_changes


def test_an_overload_belongs_to_what_it_replaces(package: Path) -> None:
    text = "def call(x): ...\n@overload(call)\ndef _(x):\n    return 1\ndef user(x):\n    call(x)\n"
    (package / "chain.py").write_text(text)
    before = kernel_stamp(package / "chain.py", "user")
    (package / "chain.py").write_text(text.replace("return 1", "return 2"))
    kernel_module._definitions.cache_clear()
    assert kernel_stamp(package / "chain.py", "user") != before


def test_a_file_that_changed_since_the_process_began_has_a_stamp_of_its_own(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What runs is older: kept under the file's stamp, it would be taken for the new version."""
    outer, apart = _stamps(package)
    monkeypatch.setitem(kernel_module._dates, str(package / "scale.py"), 1)
    changed_outer, changed_apart = _stamps(package)
    assert changed_outer != outer and changed_outer != _stamps(package)[0]
    assert changed_apart == apart


PROGRAM = """
import sys
sys.path.insert(0, sys.argv[1])
import caller
print(caller.twice(3.0), sum(caller.twice.stats.cache_hits.values()))
"""


def test_a_kernel_runs_in_its_present_version_and_from_disk_if_nothing_changed(
    tmp_path: Path,
) -> None:
    head = "from wrenchsight.models.numerics.kernel import kernel\n"
    caller = tmp_path / "caller.py"

    def run() -> str:
        result = subprocess.run(
            [sys.executable, "-c", PROGRAM, str(tmp_path)],
            capture_output=True,
            text=True,
            check=True,
        )
        return result.stdout.strip()

    caller.write_text(f"{head}@kernel\ndef twice(x):\n    return 2.0 * x\n")
    assert run() == "6.0 0"
    caller.write_text(f'{head}\n\n@kernel\ndef twice(x):\n    """Words."""\n    return 2.0 * x\n')
    assert run() == "6.0 1"  # a docstring, and another line: the compiled one is taken
    caller.write_text(f"{head}@kernel\ndef twice(x):\n    return 2.5 * x\n")
    assert run() == "7.5 0"


@kernel(**NO_NEW_ARRAYS)
def _makes_one_all_the_same(x: Array) -> float:
    return np.empty(2).size + x[0]


@kernel(**NEW_ARRAYS)
def _by_a_made_one(x: Array) -> float:
    made = np.empty(1)
    made[0] = 2.0 * x[0]
    return float(made[0])


@kernel(**NO_NEW_ARRAYS)
def _borrows(x: Array) -> float:
    return _by_a_made_one(x[1:])


def test_a_kernel_that_only_borrows_arrays_says_so_for_itself_alone() -> None:
    x = np.array([1.0, 3.0])
    assert _borrows(x) == 6.0  # what it calls makes an array, and is compiled for that
    with pytest.raises(NumbaError, match="Only accept returning of array passed"):
        _makes_one_all_the_same(x)


def test_a_record_that_was_renamed_since_is_compiled_anew(tmp_path: Path) -> None:
    """The list of compiled code names the record, which can no longer be imported."""
    source = """from typing import NamedTuple
from wrenchsight.models.numerics.kernel import kernel
class Sample(NamedTuple):
    x: float
@kernel
def twice(sample):
    return 2.0 * sample.x
print(twice(Sample(3.0)))
"""

    def run(text: str) -> str:
        (tmp_path / "caller.py").write_text(text)
        result = subprocess.run(
            [sys.executable, "-c", "import caller"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        return result.stdout.strip()

    assert run(source) == "6.0"
    assert run(source.replace("Sample", "Measurement")) == "6.0"


def test_numba_s_own_stamp_misses_a_change_in_a_used_function_of_another_file(
    tmp_path: Path,
) -> None:
    """Why there are stamps here; once this fails, `numba.njit(cache=True)` will do."""
    (tmp_path / "caller.py").write_text(
        "from numba import njit\nfrom used import factor\n"
        "@njit(cache=True)\ndef call(x):\n    return factor(x) + 1.0\nprint(call(3.0))\n"
    )

    def run(factor: float) -> str:
        (tmp_path / "used.py").write_text(
            f"from numba import njit\n@njit(cache=True)\ndef factor(x):\n    return {factor} * x\n"
        )
        result = subprocess.run(
            [sys.executable, "-B", "-c", "import caller"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        return result.stdout.strip()

    assert run(2.0) == "7.0"
    assert run(5.0) == "7.0"  # 16 is right
