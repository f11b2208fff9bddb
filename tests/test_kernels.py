"""Every kernel is compiled in the same way and says the types of what it takes."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("models", "systems", "diagrams", "analyses")


def _kernels() -> list[tuple[str, ast.FunctionDef, ast.expr]]:
    """The functions of the four packages that are decorated with `njit`, with its decorator."""
    found = []
    for file in sorted(file for package in PACKAGES for file in (ROOT / package).rglob("*.py")):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if not isinstance(node, ast.FunctionDef):
                continue
            for decorator in node.decorator_list:
                if "njit" in ast.unparse(decorator).split("(")[0]:
                    place = f"{file.relative_to(ROOT)}:{node.name}"
                    found.append((place, node, decorator))
    return found


KERNELS = _kernels()


def test_they_are_found() -> None:
    assert len(KERNELS) > 100


@pytest.mark.parametrize("place, kernel, decorator", KERNELS, ids=[place for place, *_ in KERNELS])
def test_it_is_of_the_one_dialect(place: str, kernel: ast.FunctionDef, decorator: ast.expr) -> None:
    # Without it a division by zero is an exception in one kernel and inf in the next.
    assert "error_model='numpy'" in ast.unparse(decorator)
    assert kernel.returns is not None, "what it returns"
    assert all(argument.annotation is not None for argument in kernel.args.args)
