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


def test_lines_with_labels_give_names_and_units() -> None:
    """As TwinCAT's Scope exports one time for all channels, and other recorders."""
    lines = ["Name;Project", "Begin;1335;Monday", "", "Name;Axis 1.ActPos;Axis 2.ActPos",
             "Comment;;", "Unit;deg;deg", "Type;REAL64;REAL64", "Offset;0;0", "Cyclic;True;1", "",
             "13350;13,71;-96,80", "13360;13,86;-96,79", "13370;13,90;-96,70"]  # fmt: skip
    head = table_head(lines)
    assert head.names == ("Time", "Axis 1.ActPos [deg]", "Axis 2.ActPos [deg]")
    assert (head.skip_lines, head.num_lines, head.decimal_mark) == (3, 10, ",")
    assert "names are read from line 4, one of 6 with labels" in head.notices
    # A column of words is none of labels.
    assert table_head(["state,q1,q2", "run,1,2", "run,3,4"]).names == ("state", "q1", "q2")


def test_the_end_of_a_preamble_is_no_line_of_names() -> None:
    """As LabVIEW writes a measurement: one name, of comments, has no cells below it."""
    lines = ["LabVIEW Measurement", "Channels\t6\t", *(f"{x}\t1\t1\t1\t1\t1\t1" for x in "XYZ"),
             "***End_of_Header***" + 6 * "\t", "X_Value\ta\tb\tc\td\te\tf\tComment",
             *(f"0.0{k}\t1\t2\t3\t4\t5\t6" for k in range(6))]  # fmt: skip
    head = table_head(lines)
    assert head.names == ("X_Value", *"abcdef")
    assert (head.skip_lines, head.num_columns) == (6, 7)


def test_numbers_of_columns_are_no_names() -> None:
    lines = ["Cell 3,,", "Date,Time,1,2,3", ",,POS_J1,POS_J2,CUR_J1", ",,deg,deg,mA",
             "2024-05-17,10:57:01,0.1,0.2,3", "2024-05-17,10:57:01,0.1,0.2,4"]  # fmt: skip
    names = ("Date", "Time", "POS_J1 [deg]", "POS_J2 [deg]", "CUR_J1 [mA]")
    assert table_head(lines).names == names


def test_a_step_above_an_empty_time_is_its_rate() -> None:
    """As LabVIEW writes measurements without an X column: two headers, the second one of labels."""
    lines = [
        "LabVIEW Measurement\t", "Separator\tTab", "***End_of_Header***\t", "",
        "Channels\t2\t\t", "Samples\t40\t40\t", "Y_Unit_Label\tdeg\tA\t",
        "X0\t0,000E+0\t0,000E+0\t", "Delta_X\t0,020000\t0,020000\t", "***End_of_Header***",
        "X_Value\tAchsposition 1\tMotorstrom 1\tComment",
        *(f"\t{k},125\t{k},5\t" for k in range(40)),
    ]  # fmt: skip
    head = table_head(lines)
    assert head.names == ("Time", "Achsposition 1 [deg]", "Motorstrom 1 [A]", "Comment")
    assert (head.num_lines, head.is_labelled) == (11, True)
    assert head.rate_hz == pytest.approx(50.0)


@pytest.mark.parametrize(
    "line", ["double robot(40,3) # columns: time, q[1], i[1]", "# fields: time q[1] i[1]"]
)
def test_names_may_stand_behind_other_words(line: str) -> None:
    """As a CombiTimeTable has them, behind its size."""
    head = table_head(["#1", line, *(f"{0.01 * k:g}\t{k}.5\t{k}" for k in range(40))])
    assert head.names == ("time", "q[1]", "i[1]")
    assert head.num_lines == 2


def test_words_on_registers_below_their_names_are_the_names() -> None:
    lines = [
        "STAMP;LONG;LONG;LONG;BIT",
        "TIME;D1000;D1002;D1200;M100",
        ";J1 POS deg;J2 POS deg;J1 CUR mA;",
        *(f"{k};{k};2;3;0" for k in range(10)),
    ]
    head = table_head(lines)
    assert head.names == ("STAMP TIME", "J1 POS deg", "J2 POS deg", "J1 CUR mA", "BIT M100")
    assert "the columns are called as line 3 says" in head.notices
    # Where the line above names the signals itself, such a line is none.
    lines[1] = "TIME;J1 POS;J2 POS;J1 CUR;M100"
    assert table_head(lines).names == ("STAMP TIME", "LONG J1 POS", "LONG J2 POS", "LONG J1 CUR",
                                       "BIT M100")  # fmt: skip
