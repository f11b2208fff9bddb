"""Pages that name a file, a function or a library: each is there."""

import ast
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def rows(page, heading=""):
    """The cells of the tables' rows, without their heads.

    Args:
        heading: of the one section that is read; empty: the whole page.
    """
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    if heading:
        text = text.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    lines = text.splitlines()
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line, after in zip(lines, [*lines[1:], ""], strict=True)
        if line.startswith("| ") and not after.startswith("|---")
    ]


_QUESTIONS = "extending.md", "Where to change what"


def defined_in(path):
    """The names at the top level of a file."""
    names = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            names |= {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
    return names


@pytest.mark.parametrize("row", rows(*_QUESTIONS), ids=lambda row: row[0])
def test_the_named_functions_are_in_the_named_files(row):
    _, files, functions = row
    defined = set().union(*(defined_in(ROOT / file) for file in re.findall(r"`(.+?)`", files)))
    named = re.findall(r"`(\w+)`", re.sub(r"\(.*?\)", "", functions))
    assert named and set(named) <= defined


def test_ten_questions_are_answered():
    assert len(rows(*_QUESTIONS)) == 10


def test_every_library_has_its_line():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    wanted = {*project["dependencies"]}.union(*(extras[e] for e in extras if e not in _OF_MAKERS))
    named = {
        name
        for row in rows("dependencies.md")
        for name in re.findall(r"`([\w.-]+)`", row[0] if row[0] not in _quoted(extras) else row[1])
    }
    assert {re.split(r"[<>=;\[]", text)[0] for text in wanted} <= named


_OF_MAKERS = ("test", "lint", "docs")


def _quoted(names):
    return {f"`{name}`" for name in names}
