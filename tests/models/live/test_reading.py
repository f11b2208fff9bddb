"""The row of a reading: as many numbers as its type says, under their names."""

import numpy as np
import pytest

from wrenchsight.models.estimation.invalid import STREAM_LATE
from wrenchsight.models.live.reading import Reading, reading_type, row_size


@pytest.mark.parametrize("n", [1, 6, 7])
def test_a_reading_is_its_row(n: int) -> None:
    wrench, covariance = np.arange(6.0), np.diag(np.arange(1.0, 7.0)) ** 2
    tau_ext, q = np.arange(n) + 0.5, -np.arange(n, dtype=float)
    made = Reading.of(wrench, covariance, tau_ext, q, t=3.5, link=2, contact=True)
    assert made.row.shape == (row_size(n),)
    again = Reading(np.stack([made.row, made.row])[-1])  # as from a ring of rows
    assert again.numbers.dtype == reading_type(n)
    for part, expected in (
        (again.wrench, wrench),
        (again.covariance, covariance),
        (again.sd, np.arange(1.0, 7.0)),
        (again.tau_ext, tau_ext),
        (again.q, q),
    ):
        np.testing.assert_array_equal(part, expected)
    assert (again.t, again.link, again.contact, again.misfit, again.valid) == (
        3.5,
        2,
        True,
        False,
        True,
    )


def test_what_is_noted_of_a_reading_stands_in_its_row() -> None:
    reading = Reading.of(np.zeros(6), np.eye(6), np.zeros(6), np.zeros(6), contact=True)
    reading.publish(4.0)
    assert Reading(reading.row.copy()).published == 4.0
    late = reading.unusable(received=2.0)
    assert (late.invalid, late.contact, late.received) == (STREAM_LATE, False, 2.0)
    assert reading.valid and reading.contact  # a copy


def test_a_number_that_a_reading_does_not_have_is_refused() -> None:
    with pytest.raises(ValueError, match="speed"):
        Reading.of(np.zeros(6), np.eye(6), np.zeros(6), np.zeros(6), speed=1.0)
