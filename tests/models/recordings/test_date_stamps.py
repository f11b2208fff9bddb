"""Dates with times as loggers write them; the oracle is Python's datetime."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.date_stamps import stamp_form, stamp_seconds
from wrenchsight.models.recordings.recording_reader import read_recording

NOON = datetime(2024, 3, 5, 12, 0, 0, tzinfo=UTC).timestamp()  # of 5 March


@pytest.mark.parametrize(
    ("cell", "seconds"),
    [
        ("05.03.2024 12:00:01,250", NOON + 1.25),
        ("5.3.2024 12:00:01", NOON + 1.0),
        ("05-03-2024 12:00:01.249999", NOON + 1.249999),
        ("03/05/2024 12:00:01.5", NOON + 1.5),  # the month first
        ("3/5/2024 12:00:01 PM", NOON + 1.0),
        ("3/5/2024, 1:00:01 pm", NOON + 3601.0),
        ("3/5/2024 12:00:01 AM", NOON + 1.0 - 43200.0),
        ("15/03/2024 12:00:01", NOON + 1.0 + 10 * 86400.0),  # 15 is no month
        ("2024/03/05 12:00:01.25", NOON + 1.25),
        ("2024-03-05 12:00:01,25", NOON + 1.25),
        ("12:00:01.250", 43201.25),
    ],
)
def test_dates_are_seconds_since_1970(cell: str, seconds: float) -> None:
    form = stamp_form(cell)
    assert form is not None
    assert form.fits(cell)
    read = stamp_seconds(pa.chunked_array([pa.array([cell, None], pa.string())]), form)
    # A double holds such times to .24 us.
    assert read[0].as_py() == pytest.approx(seconds, abs=5e-7)
    assert read[1].as_py() is None


@pytest.mark.parametrize("cell", ["0.25", "soon", "2024-03-05", "12:00", "1.2.3", ""])
def test_what_is_no_date_with_a_time_has_no_form(cell: str) -> None:
    assert stamp_form(cell) is None


def test_a_log_with_local_dates_is_read(tmp_path: Path) -> None:
    """Semicolons and the day first, as a PLC writes it."""
    t = 0.01 * np.arange(40)
    q = np.sin(t)
    rows = [f"05.03.2024 12:00:{x:06.3f};{y:.6f};0;1" for x, y in zip(t, q, strict=True)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["Datum/Zeit;q1;v1;i1", *rows]) + "\n")
    log = read_recording(path)
    np.testing.assert_allclose(log.t, NOON + t, rtol=0, atol=5e-7)
    np.testing.assert_allclose(log.q[:, 0], q, rtol=0, atol=5e-7)
    rows[20] = rows[20].replace("05.03.2024", "some day")
    path.write_text("\n".join(["Datum/Zeit;q1;v1;i1", *rows]) + "\n")
    with pytest.raises(InputError, match=r"line 22, column 1 .*some day"):
        read_recording(path)
    rows[20] = rows[20].replace("some day", "45.13.2024")
    path.write_text("\n".join(["Datum/Zeit;q1;v1;i1", *rows]) + "\n")
    with pytest.raises(InputError):
        read_recording(path)


@pytest.mark.parametrize(
    ("names", "date", "clock", "description"),
    [
        ("Date,Time", "%Y-%m-%d", "%H:%M:%S.%f", ""),
        ("Uhrzeit,Datum", "%d.%m.%Y", "%H:%M:%S.%f", ""),
        ("date,time", "%m/%d/%Y", "%I:%M:%S.%f %p", ""),
        ("day,clock", "%Y-%m-%d", "%H:%M:%S.%f", "day, clock"),
    ],
)
def test_a_date_and_a_time_in_two_columns_are_one_time(
    tmp_path: Path, names: str, date: str, clock: str, description: str
) -> None:
    """Over midnight, which a time of day alone does not pass."""
    begin = datetime(2024, 3, 5, 23, 59, 59, 800000, tzinfo=UTC)
    t = 0.01 * np.arange(40)
    stamps = [begin + timedelta(seconds=float(x)) for x in t]
    cells = [(s.strftime(date), s.strftime(clock)) for s in stamps]
    cells = [pair[::-1] if names.startswith("Uhrzeit") else pair for pair in cells]
    rows = [f"{a}, {b},{x:.6f},0,1" for (a, b), x in zip(cells, np.sin(t), strict=True)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([f"{names},q1,v1,i1", *rows]) + "\n")
    form: Path | None = None
    if description:
        form = tmp_path / "form.yaml"
        keys = {"position": "q1", "velocity": "v1", "current": "i1", "time": f'"{description}"'}
        lines = [f"{key}: {{columns: {columns}}}" for key, columns in keys.items()]
        form.write_text("\n".join(lines))
    log = read_recording(path, form)
    np.testing.assert_allclose(log.t, begin.timestamp() + t, rtol=0, atol=5e-7)


def test_a_description_that_names_the_date_alone_is_told_of_the_time(tmp_path: Path) -> None:
    path, form = tmp_path / "log.csv", tmp_path / "form.yaml"
    rows = [f"2024-03-05,12:00:00.{k}0,0.{k},0,1" for k in range(10, 40)]
    path.write_text("\n".join(["day,clock,q1,v1,i1", *rows]) + "\n")
    form.write_text("time: {columns: day}\nposition: {columns: q1}\ncurrent: {columns: i1}\n")
    with pytest.raises(InputError, match="this is a date: name the column of its time of day"):
        read_recording(path, form)
