"""Every kernel is compiled in the same way and says the types of what it takes."""

import ast
from pathlib import Path

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


def test_each_annotates_its_types_and_is_kept_on_disk() -> None:
    functions = _functions()
    kernels = [(place, node) for place, node, decorator in functions if decorator == "kernel"]
    assert len(kernels) > 100  # they are found
    untyped = [
        place
        for place, node in kernels
        if node.returns is None or any(a.annotation is None for a in node.args.args)
    ]
    assert not untyped, "say what it takes and returns"
    # A function made inside another, at run time, has no place of its own on disk.
    assert sum(decorator == "njit" for _, _, decorator in functions) <= 8
