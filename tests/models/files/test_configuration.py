from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.files.configuration import (
    REQUIRED,
    load_configuration,
    nearest,
    save_configuration,
)
from wrenchsight.models.files.input_error import InputError


@dataclass
class Ball:
    radius: float = 0.1


@dataclass
class Box:
    sides: list[float] = field(default_factory=lambda: [1.0, 1.0, 1.0])


@dataclass
class Thing:
    name: str = field(default="", metadata=REQUIRED)
    count: int = 1
    mass: float = 1.0
    fixed: bool = False
    path: Path = Path()
    matrix: np.ndarray = field(default_factory=lambda: np.zeros((2, 2)))
    shape: Ball | Box = field(default_factory=Ball)
    balls: list[Ball] = field(default_factory=list)
    limits: dict[str, float] = field(default_factory=dict)
    lid: Ball | None = None


def write(folder: Path, text: str) -> Path:
    path = folder / "thing.yaml"
    path.write_text(text)
    return path


def test_reads_every_kind_of_value(tmp_path: Path) -> None:
    thing = load_configuration(
        write(
            tmp_path,
            "name: cup\ncount: 3\nmass: 1e-3\nfixed: true\npath: a/b\nmatrix: [[1, 2], [3, 4.5]]\n"
            "shape: !Box {sides: [1, 2, 3]}\nballs:\n- {radius: 2}\n- {}\nlimits: {a: 1}\n"
            "lid: {radius: .5}\n",
        ),
        Thing,
    )
    assert thing.mass == 1e-3  # which YAML 1.1 itself takes for a text
    assert (thing.name, thing.count, thing.fixed, thing.path) == ("cup", 3, True, Path("a/b"))
    np.testing.assert_array_equal(thing.matrix, [[1.0, 2.0], [3.0, 4.5]])
    assert thing.shape == Box([1.0, 2.0, 3.0])
    assert thing.balls == [Ball(2.0), Ball(0.1)]
    assert thing.limits == {"a": 1.0}
    assert thing.lid == Ball(0.5)


def test_null_optional_and_default_union_are_read(tmp_path: Path) -> None:
    thing = load_configuration(write(tmp_path, "name: a\nlid: null\nshape: {radius: 3}\n"), Thing)
    assert thing.lid is None
    assert thing.shape == Ball(3.0)


def test_saved_numbers_are_read_back_to_the_last_digit(tmp_path: Path) -> None:
    thing = Thing("a", 2, 1 / 3, True, Path("x"), np.array([[0.1, 1e-17]]), Box([1e300]), [Ball()])
    path = tmp_path / "saved.yaml"
    save_configuration(thing, path)
    again = load_configuration(path, Thing)
    np.testing.assert_array_equal(again.matrix, thing.matrix)
    again.matrix = thing.matrix
    assert again.__dict__ == thing.__dict__


def test_nothing_is_saved_where_the_default_is_something(tmp_path: Path) -> None:
    @dataclass
    class Room:
        name: str = ""
        floor: float | None = 0.0
        ceiling: float | None = None

    save_configuration(Room("hall", None), tmp_path / "saved.yaml")
    assert load_configuration(tmp_path / "saved.yaml", Room) == Room("hall", None)
    assert "ceiling" not in (tmp_path / "saved.yaml").read_text()


def test_a_table_of_configurations_and_yaml_templates(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        "_base: &base {count: 7}\na: {<<: *base, name: x}\nb: {<<: *base, name: y, count: 8}\n",
    )
    table = load_configuration(path, dict[str, Thing])  # type: ignore[type-var]
    assert {key: (thing.name, thing.count) for key, thing in table.items()} == {
        "a": ("x", 7),
        "b": ("y", 8),
    }


def test_a_second_read_is_independent_of_changes_to_the_first(tmp_path: Path) -> None:
    path = write(tmp_path, "name: a\nballs: [{radius: 2}]\n")
    first = load_configuration(path, Thing)
    first.balls[0].radius = 5.0
    assert load_configuration(path, Thing).balls == [Ball(2.0)]
    write(tmp_path, "name: a\nballs: [{radius: 3}]\n")
    assert load_configuration(path, Thing).balls == [Ball(3.0)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("name: a\nmas: 1\n", 'line 2: unknown key "mas"; did you mean "mass"?'),
        ("name: a\nzzzz: 1\n", 'line 2: unknown key "zzzz"; known keys: name, count'),
        ("name: a\nname: b\n", 'line 2: the key "name" is given twice'),
        ("count: 2\n", 'the file lacks the key "name"'),
        ("name: a\n\ncount: 1.5\n", 'line 3, count: expected a whole number, found "1.5"'),
        ("name: a\nmass: heavy\n", 'line 2, mass: expected a number, found "heavy"'),
        ("name: a\nmass: .nan\n", "line 2, mass: expected a number"),
        ("name: a\nmass: true\n", "line 2, mass: expected a number"),
        ("name: a\nmass:\n", "line 2, mass: expected a number, found nothing"),
        ("name: a\nmass: [1]\n", "line 2, mass: expected a number, found a list"),
        ("name: 5\n", 'line 1, name: expected a text, found "5"'),
        ("name: a\nfixed: 1\n", "line 2, fixed: expected true or false"),
        ("name: a\nballs: {radius: 1}\n", "line 2, balls: expected a list, found keys with values"),
        ("name: a\nballs:\n- radius: 1\n- radus: 2\n", 'line 4: unknown key "radus" of "balls[1]"'),
        ("name: a\nlid: 3\n", 'line 2, lid: expected keys with values, found "3"'),
        ("name: a\nshape: !Bocks {}\n", "line 2, shape: unknown kind !Bocks, expected !Ball or"),
        ("name: a\nmatrix: [[1], [2, 3]]\n", "line 2, matrix: the rows have different lengths"),
        ("name: a\nmatrix: [[1, x]]\n", 'line 2, matrix[0][1]: expected a number, found "x"'),
        ("name: a\nlimits: {a: b}\n", "line 2, limits.a: expected a number"),
        ("name: [a\n", "no valid YAML"),
        ("- a\n", "line 1: expected keys with values, found a list"),
        ("", "the file is empty"),
    ],
)
def test_an_error_is_one_line_with_its_place(tmp_path: Path, text: str, expected: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(InputError) as error:
        load_configuration(path, Thing)
    line = str(error.value)
    assert line.startswith(f"{path}: ")
    assert expected in line
    assert "\n" not in line


def test_files_that_are_no_text(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_configuration(tmp_path / "absent.yaml", Thing)
    with pytest.raises(InputError, match="is a directory"):
        load_configuration(tmp_path, Thing)
    (tmp_path / "model.yaml").write_text("")
    with pytest.raises(InputError, match=r"name a file in it: \S*model\.yaml$"):
        load_configuration(tmp_path, Thing)
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(InputError, match="no text file"):
        load_configuration(binary, Thing)


def test_nearest() -> None:
    assert nearest("hme", ["home", "drives"]) == 'did you mean "home"?'
    assert nearest("qqq", ["home"]) == ""


ODD_YAML = {
    "int": "!!int abc",
    "timestamp": "!!timestamp 2020-13-45",
    "bool": "!!bool maybe",
    "custom": "!custom 3",
    "python": '!!python/object/apply:os.system ["true"]',
    "equals": "=",
    "merge": "<<",
    "nul": '"a\\0b"',
    "zero byte": "a\0b",
    "itself": "&a [*a]",
    "digits": "9" * 5000,
    "decimals": "1." + "3" * 5000 + "x",
    "float": "!!float abc",
    "binary": '!!binary "===="',
    "set": "!!set {a, b}",
    "omap": "!!omap [a: 1]",
    "hexadecimal": "0x" + "f" * 5000,
    "alias": "*nothing",
    "surrogate": '"\\ud800"',
    "escape": '"\\e[31m"',
}
_WORDS = {"equals", "merge", "decimals"}  # where a text is expected


@pytest.mark.parametrize("key", ["name", "count", "mass", "fixed", "path", "matrix"])
@pytest.mark.parametrize("value", ODD_YAML)
def test_odd_yaml_is_one_line(tmp_path: Path, key: str, value: str) -> None:
    path = write(tmp_path, f"{key}: {ODD_YAML[value]}\n")
    if key in ("name", "path") and value in _WORDS:
        return
    with pytest.raises(InputError) as caught:
        load_configuration(path, Thing)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


_DEEP = ("[" * 1200 + "]" * 1200, "[" * 1200, "{a: " * 600 + "1" + "}" * 600)


@pytest.mark.parametrize(
    "text",
    ["=", "<<", "{{a: 1}: 2}", "=: 3", "<<: 3", "\0", "\ta: 1", *(f"name: {x}" for x in _DEEP)],
)
def test_an_odd_document_is_one_line(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError) as caught:
        load_configuration(write(tmp_path, text), Thing)
    assert "\n" not in str(caught.value)


def test_a_file_without_an_end_is_one_line():
    with pytest.raises(InputError, match="larger than 8 MB"):
        load_configuration("/dev/zero", Thing)


def test_control_characters_are_escaped():
    line = str(InputError("a\udcff.csv", "line 3", "found \x1b]0;title\x07"))
    assert line == "a\\udcff.csv: line 3: found \\x1b]0;title\\x07"
    line.encode()


def _nested_aliases(depth: int) -> str:
    """A list of 9 ** depth numbers in a few lines."""
    lines = ["_a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"_a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, depth)]
    return "\n".join([*lines, f"matrix: *a{depth - 1}", "name: x\n"])


_LONG_ROW = f"_r: &r [{', '.join(['1'] * 3000)}]\nmatrix: [{', '.join(['*r'] * 2000)}]\nname: x\n"


@pytest.mark.parametrize("text", [_nested_aliases(10), _LONG_ROW], ids=["nested", "long row"])
def test_aliases_that_stand_for_millions_of_values_are_one_line(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match=r"aliases repeat .* values, expected 100000 at most"):
        load_configuration(write(tmp_path, text), Thing)


def test_an_alias_within_its_own_anchor_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"line 1.*stands inside its own anchor"):
        load_configuration(write(tmp_path, "matrix: &m [*m]\nname: x\n"), Thing)
