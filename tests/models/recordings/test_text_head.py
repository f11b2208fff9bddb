"""Where a table begins in a text, what separates its cells, and how its columns are called."""

import pytest

from wrenchsight.models.recordings.text_head import table_head

_ROWS = ["0.00{s}0.1{s}1.5{s}2", "0.01{s}0.2{s}1.5{s}2", "0.02{s}0.3{s}1.6{s}2"]
_NAMES = ("time", "q1", "v1", "i1")


def _rows(separator: str, decimal_mark: str = ".") -> list[str]:
    return [row.replace(".", decimal_mark).format(s=separator) for row in _ROWS]


@pytest.mark.parametrize("decimal_mark", [".", ","])
@pytest.mark.parametrize("separator", [";", "\t", "|", ",", " ", ", ", "; ", "   "])
@pytest.mark.parametrize("above", [[], ["Run 12, of a robot"], ["# a", "# rate: 100 Hz", ""],
                                   ["sep=;"], ["Rate,100", "Operator;N. N."]])  # fmt: skip
def test_the_table_is_found(above: list[str], separator: str, decimal_mark: str) -> None:
    if separator.strip(" ") == decimal_mark:
        pytest.skip("commas cannot be both")
    lines = [*above, separator.join(_NAMES), *_rows(separator, decimal_mark)]
    head = table_head(lines)
    assert head.separator == (separator.strip(" ") or " ")
    assert head.decimal_mark == decimal_mark
    assert head.names == _NAMES
    assert (head.skip_lines, head.num_lines) == (len(above), len(above) + 1)
    assert head.first_cells[1].replace(",", ".") == "0.1"


@pytest.mark.parametrize(
    ("header", "names"),
    [
        (["time,q1,v1,i1", "s,rad,rad/s,A"], ("time [s]", "q1 [rad]", "v1 [rad/s]", "i1 [A]")),
        (["time,q1,v1,i1", "[s],[deg],,[mA]"], ("time [s]", "q1 [deg]", "v1", "i1 [mA]")),
        (["time,q1,v1,i1", "LREAL,LREAL,LREAL,INT"], _NAMES),
        (["time;q1;v1;i1"], _NAMES),  # by another separator than the rows
        (["# time q1 v1 i1"], _NAMES),
        (["Time,Axis 1,,", "[s],Position,Velocity,Current"],
         ("Time [s]", "Axis 1 Position", "Axis 1 Velocity", "Axis 1 Current")),
        (["time,q1,v1"], ("time", "q1", "v1")),  # the rows are refused for their fourth cell
        ([], None),
    ],
)  # fmt: skip
def test_lines_above_the_rows_are_told_apart(
    header: list[str], names: tuple[str, ...] | None
) -> None:
    head = table_head([*header, *_rows(",")])
    assert head.names == names
    assert head.num_lines == len(header)


def test_a_column_without_a_name_is_the_index_or_behind_the_last_separator() -> None:
    rows = [f"{k},{row}" for k, row in enumerate(_rows(","))]
    assert table_head(["time,q1,v1,i1", *rows]).names == ("", *_NAMES)
    rows = [f"{row}," for row in _rows(",")]
    assert table_head(["time,q1,v1,i1", *rows]).names == (*_NAMES, "")
    assert table_head(["time,q1,v1,i1,", *_rows(",")]).names == _NAMES


def test_a_stated_header_is_taken() -> None:
    lines = ["", "time,q1,v1,i1", *_rows(",")]
    assert table_head(lines, ",", ".", header=True).names == _NAMES
    head = table_head(lines[2:], ",", ".", header=False)
    assert head.names is None
    assert (head.num_columns, head.num_lines) == (4, 0)


def test_marked_lines_above_names_without_a_mark_are_remarks() -> None:
    head = table_head([
        "#group,false,true,true", "#datatype,long,dateTime:RFC3339,double", ",table,_time,_value",
        ",0,2024-06-03T07:33:20.12Z,-4.5", ",0,2024-06-03T07:33:20.13Z,-4.6",
    ])  # fmt: skip
    assert head.names == ("", "table", "_time", "_value")


def test_marked_names_above_units_without_a_mark_stay_the_names() -> None:
    head = table_head(["# t,q1,q2", "s,rad,rad", "0.0,0.1,0.2", "0.1,0.1,0.2"])
    assert head.names == ("t [s]", "q1 [rad]", "q2 [rad]")
