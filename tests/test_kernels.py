"""Every kernel is compiled in the same way and says the types of what it takes."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("models", "systems", "diagrams", "analyses")


def _functions() -> list[tuple[str, ast.FunctionDef, str]]:
    """The functions of the four packages that are decorated, with each decorator."""
    return [
        (f"{file.relative_to(ROOT)}:{node.name}", node, ast.unparse(decorator).split("(")[0])
        for package in PACKAGES
        for file in sorted((ROOT / package).rglob("*.py"))
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
        for decorator in node.decorator_list
    ]


FUNCTIONS = _functions()
KERNELS = [(place, node) for place, node, decorator in FUNCTIONS if decorator == "kernel"]


def test_they_are_found() -> None:
    assert len(KERNELS) > 100


def test_all_but_functions_made_at_run_time_are_kept_on_disk() -> None:
    # A function made inside another has no place of its own on disk.
    assert sum(decorator == "njit" for _, _, decorator in FUNCTIONS) <= 8


@pytest.mark.parametrize("place, kernel", KERNELS, ids=[place for place, *_ in KERNELS])
def test_every_kernel_annotates_its_types(place: str, kernel: ast.FunctionDef) -> None:
    assert kernel.returns is not None, "what it returns"
    assert all(argument.annotation is not None for argument in kernel.args.args)
