"""Descriptions of logs: what they say, and the one line for each way to say it wrong."""

from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.files.bundled_files import bundled_files
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording_format import (
    FORMATS,
    LogHeader,
    RecordingFormat,
    SignalColumns,
    load_format,
    resolve_layout,
    rows_for,
)

_LOG = Path("log.csv")


def _written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "format.yaml"
    path.write_text(text)
    return path


def _layout(form: RecordingFormat, names=None, num_columns=0):
    header = LogHeader(_LOG, names, num_columns or len(names))
    return resolve_layout(form, "format.yaml", header)


def _columns(text: str, names: list[str]) -> tuple[int, ...]:
    form = RecordingFormat(time=SignalColumns("t"), extra={"x": SignalColumns(text)})
    return _layout(form, names).signal("x").columns


def test_numbers_names_and_series_name_columns() -> None:
    names = ["t", "a_0_0", "a_0_1", "a_1_0", "a_1_1", "b"]
    assert _columns("2-4", names) == (1, 2, 3)
    assert _columns("5, 2..3", names) == (4, 1, 2)
    assert _columns("b, a_0_1", names) == (5, 2)
    assert _columns("a_{0..1}_{0..1}", names) == (1, 2, 3, 4)  # the last one runs fastest


def test_units_gains_and_offsets_give_si_units() -> None:
    form = RecordingFormat(
        header=False,
        time=SignalColumns(1, "ms"),
        position=SignalColumns("2-3", "deg", gain=[-1.0, 1.0], offset=[0.5]),
        velocity=SignalColumns("4-5", "rpm"),
        current=SignalColumns("6-7", "mA", gain=[2.0]),
    )
    layout = _layout(form, num_columns=7)
    np.testing.assert_allclose(layout.signal("t").scale, [1e-3])
    np.testing.assert_allclose(layout.signal("q").scale, [-np.pi / 180, np.pi / 180])
    np.testing.assert_allclose(layout.signal("q").offset, [0.5, 0.5])
    np.testing.assert_allclose(layout.signal("v").scale, [2 * np.pi / 60] * 2)
    np.testing.assert_allclose(layout.signal("current").scale, [2e-3, 2e-3])


def test_the_bundled_descriptions_load() -> None:
    assert {"panda-tactile-pad", "ur10e-dynamic-calibration"} <= bundled_files(FORMATS).keys()
    for name in bundled_files(FORMATS):
        form, _ = load_format(name)
        assert form.description and form.source
    ur10e, _ = load_format("ur10e-dynamic-calibration")
    assert rows_for(ur10e, Path("x/ur-20_02_19_14harm50secLoad.csv")) == (308, 5071)
    assert rows_for(ur10e, Path("ur-20_01_22-joint_3.csv")) is None
    assert rows_for(ur10e, Path("another.csv")) is None
    layout = resolve_layout(ur10e, "", LogHeader(_LOG, None, 31))
    assert layout.signal("current").columns == tuple(range(13, 19))
    assert layout.column_of("v", 2) == "column 10"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("time: {columns: 1}\nvelocitty: {columns: 2}", "line 2.*velocitty.*velocity"),
        ("header: false", "time: is missing; name its columns, or give rate_hz"),
        ("time: {columns: 1}\nrate_hz: 5", "rate_hz: is given beside time"),
        ("rate_hz: -1", "rate_hz: -1, expected samples a second"),
        ("time: {columns: 1}\nkeep_every: 0", "keep_every: 0, expected a number of rows"),
        ("time: {}", "time: names no column"),
        ("time: {columns: 1}\nseparator: ',,'", "separator: expected one character"),
        ("time: {columns: 1}\ndecimal_mark: ':'", 'decimal_mark: expected "." or ","'),
        ("time: {columns: 1}\ndecimal_mark: ','", "the same as the separator"),
        ("time: {columns: 1}\nskip_lines: -1", "-1, expected 0"),
        ("time: {columns: 1}\nrows: {a.csv: [5]}", r"rows, a\.csv: expected the first and the la"),
        ("time: {columns: 1}\nrows: {a.csv: [9, 5]}", r"rows, a\.csv"),
        ("time: {columns: 1}\nrows: {a.csv: [0, 5]}", r"rows, a\.csv"),
        (
            "time: {columns: 1}\nextra: {q: {columns: 2}}",
            "extra, q: this is the name of a standard signal",
        ),
    ],
)
def test_a_wrong_description_is_refused_in_one_line(tmp_path: Path, text: str, line: str) -> None:
    with pytest.raises(InputError, match=line) as caught:
        load_format(_written(tmp_path, text))
    assert "format.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_name_suggests_the_nearest() -> None:
    with pytest.raises(InputError, match='did you mean "ur10e-dynamic-calibration"'):
        load_format("ur10e-dynamic-calibraton")
    with pytest.raises(InputError, match="no such file"):
        load_format("nowhere.yaml")


_T = SignalColumns("t")


@pytest.mark.parametrize(
    ("form", "line"),
    [
        (RecordingFormat(time=SignalColumns("zeit")), 'lacks the column "zeit".*time'),
        (RecordingFormat(time=SignalColumns("?")), "time: has a question mark, where a draft"),
        (RecordingFormat(time=SignalColumns("9")), r"has 5 columns, but.*names column 9"),
        (RecordingFormat(time=_T, num_columns=6), "has 5 columns, expected 6"),
        (RecordingFormat(time=SignalColumns("t, q1, q2")), "time: has 3 columns, expected 1"),
        (RecordingFormat(time=SignalColumns("t", "hours")), 'time: unknown unit "hours".*ms'),
        (RecordingFormat(time=_T, position=SignalColumns("q1", "A")), 'position: unknown unit "A"'),
        (RecordingFormat(time=_T, position=SignalColumns("q{2..1}")), "cannot read"),
        (RecordingFormat(time=_T, position=SignalColumns("q{1..")), "cannot read"),
        (RecordingFormat(time=_T, position=SignalColumns("3-2")), "runs backwards"),
        (RecordingFormat(time=_T, position=SignalColumns("q1,,q2")), "names no column"),
        (RecordingFormat(time=_T, position=SignalColumns("q1, q1")), "names a column twice"),
        (RecordingFormat(time=_T, position=SignalColumns("q1", gain=[0.0])), "gain is zero"),
        (
            RecordingFormat(time=_T, position=SignalColumns("q{1..2}", gain=[1.0, 1.0, 1.0])),
            "position, gain: has 3 values for 2 columns",
        ),
        (
            RecordingFormat(time=_T, position=SignalColumns("q1, q2"), velocity=SignalColumns("a")),
            r"different numbers of joints \(q: 2, v: 1\)",
        ),
        (
            RecordingFormat(time=_T, extra={"J": SignalColumns("q1, q2", shape=[2, 2])}),
            "extra, J, shape: .* holds 4 numbers, but 2 columns",
        ),
        (RecordingFormat(time=_T, position=SignalColumns("q1", shape=[1])), "only an extra"),
        (RecordingFormat(time=_T, position=SignalColumns("w")), 'names the column "w" twice'),
    ],
)
def test_a_description_that_does_not_fit_the_log_is_refused(
    form: RecordingFormat, line: str
) -> None:
    with pytest.raises(InputError, match=line):
        _layout(form, ["t", "q1", "q2", "w", "w"] if "twice" in line else ["t", *"ab", "q1", "q2"])


def test_names_of_columns_need_a_header() -> None:
    with pytest.raises(InputError, match="the log has no header"):
        _layout(RecordingFormat(time=_T), num_columns=3)
