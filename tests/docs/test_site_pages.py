"""What the documentation takes from the code: every key of every file has its words."""

import importlib.util
import re
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from wrenchsight.models.files.configuration import REQUIRED
from wrenchsight.models.files.field_words import field_words

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
SCHEMAS = sorted(
    {name for page in PAGES for name in re.findall(r"<!-- schema: ([\w.]+) -->", page.read_text())}
)


@pytest.fixture(scope="module")
def site_pages():
    spec = importlib.util.spec_from_file_location("site_pages", ROOT / "docs" / "site_pages.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@dataclass
class Inner:
    """The inner one."""

    size: float = 1.0
    """m, of "a # in quotes", in
    two lines"""


@dataclass
class Outer:
    """The outer one.

    Attributes:
        limits: lower and upper
    """

    name: str = field(default="", metadata=REQUIRED)
    """what it is called"""
    below: list[Inner] = field(default_factory=list)
    """Given below."""
    inner: Inner | None = None
    limits: tuple[float, int] = (0.5, 2)


@dataclass
class Heir(Outer):
    """One that adds a field, and says more of another."""

    own: int = 3
    """its own"""
    name: str = ""
    """what the heir is called"""


@dataclass
class Silent:
    """One field says nothing that counts."""

    nothing: int = 0  # a comment is none


def test_words_are_those_below_a_field_or_of_the_class():
    words = {
        "name": "what it is called",
        "below": "Given below.",
        "inner": "The inner one.",
        "limits": "lower and upper",
    }
    assert field_words(Outer) == words
    assert field_words(Heir) == words | {"name": "what the heir is called", "own": "its own"}


def test_a_schema_is_a_table_of_each_dataclass_once(site_pages):
    text = site_pages.schema_tables(Outer)
    assert text.count("**`Inner`**: The inner one.") == 1
    assert "| `name` | text | **required** | what it is called |" in text
    assert '| `size` | number | `1.0` | m, of "a # in quotes", in two lines |' in text
    assert "| `inner` | `Inner` or null | `null` | The inner one. |" in text
    assert "| `limits` | number, whole number | `(0.5, 2)` | lower and upper |" in text


def test_a_field_without_words_is_named(site_pages):
    with pytest.raises(ValueError, match="Silent: no words for nothing"):
        site_pages.schema_tables(Silent)


@pytest.mark.parametrize("name", SCHEMAS)
def test_no_key_of_a_documented_file_is_without_words(site_pages, name):
    assert "| key | type | default | what |" in site_pages.on_page_markdown(
        f"<!-- schema: {name} -->"
    )


def test_every_public_module_is_on_one_page(site_pages):
    shown = [
        name
        for page in PAGES
        for package in re.findall(r"<!-- api: ([\w.]+) -->", page.read_text())
        for name in re.findall(r"::: ([\w.]+)", site_pages.api_of(package))
    ]
    assert sorted(shown) == sorted(
        ".".join(("wrenchsight", *file.relative_to(ROOT).with_suffix("").parts))
        for package in ("models", "systems", "diagrams", "analyses")
        for file in (ROOT / package).rglob("*.py")
        if not file.stem.startswith("_")
    )


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
def test_the_files_that_a_page_names_are_there(page):
    packages = "models|systems|diagrams|analyses|tests|docs|examples|wrenchsight"
    named = re.findall(rf"\b(?:{packages})/[\w/.-]+\.(?:py|yaml|md)\b", page.read_text())
    assert not [name for name in named if not (ROOT / name).is_file()]
