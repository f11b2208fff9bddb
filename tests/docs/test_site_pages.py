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

    size: float = 1.0  # m, of "a # in quotes"


@dataclass
class Above:
    """Each field below its comment."""

    # of the first
    first: float = 1.0
    # of the second,
    # in two lines
    second: float = 2.0
    third: float = 3.0  # of the third
    # of the last
    last: float = 4.0


@dataclass
class Below:
    """Each field above its comment."""

    first: float = 1.0
    # of the first
    second: float = 2.0
    # of the second


@dataclass
class Outer:
    """The outer one."""

    name: str = field(default="", metadata=REQUIRED)  # what it is called
    # given above
    above: int = 3
    below: list[Inner] = field(default_factory=list)
    """Given below."""
    inner: Inner | None = None
    limits: tuple[float, int] = (0.5, 2)  # lower and upper


@dataclass
class Silent:
    """One field says nothing."""

    nothing: int = 0


def test_comments_stand_on_one_side_of_the_fields_of_a_class():
    assert field_words(Above) == {
        "first": "of the first",
        "second": "of the second, in two lines",
        "third": "of the third",
        "last": "of the last",
    }
    assert field_words(Below) == {"first": "of the first", "second": "of the second"}


def test_words_are_found_beside_above_and_below_a_field(site_pages):
    assert site_pages.field_words(Outer) == {
        "name": "what it is called",
        "above": "given above",
        "below": "Given below.",
        "inner": "The inner one.",
        "limits": "lower and upper",
    }


def test_a_schema_is_a_table_of_each_dataclass_once(site_pages):
    text = site_pages.schema_tables(Outer)
    assert text.count("**`Inner`**: The inner one.") == 1
    assert "| `name` | text | **required** | what it is called |" in text
    assert '| `size` | number | `1.0` | m, of "a # in quotes" |' in text
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
