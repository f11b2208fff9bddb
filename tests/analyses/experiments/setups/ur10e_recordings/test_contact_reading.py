"""Over which times a reading is judged."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_reading import (
    BLOCK_SAMPLES,
    WINDOW_BLOCKS,
    PreparedRun,
    averaged,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_runs import CONTACT
from wrenchsight.analyses.methods.reference_sensor.judged_force import ForceReading
from wrenchsight.models.estimation.invalid import SETTLING, UNCERTAIN_FORCE

_STEP = 0.002  # s


@pytest.mark.parametrize(("interval", "size"), [("slide", WINDOW_BLOCKS), (CONTACT, 1)])
def test_a_contact_is_judged_block_by_block_and_its_parts_over_tenths_of_a_second(
    interval: str, size: int
) -> None:
    times = {interval: (0.99, 1.998)}  # 50 blocks of 20 ms lie in it, the first one from 1 s on
    log = SimpleNamespace(time_step=_STEP)
    run = SimpleNamespace(t=_STEP * np.arange(1500), log=log, intervals=times)
    prepared: Any = SimpleNamespace(run=run)
    windows = PreparedRun.windows(prepared, interval)
    first = round(1.0 / _STEP) // BLOCK_SAMPLES
    expected = np.arange(first, first + 50).reshape(-1, size)
    np.testing.assert_array_equal(windows, expected)
    assert PreparedRun.windows(prepared, "hold1").shape == (0, WINDOW_BLOCKS)


def test_an_average_has_the_reasons_of_all_its_blocks() -> None:
    reasons = np.array([0, SETTLING, UNCERTAIN_FORCE, 0])
    reading = ForceReading(np.arange(4.0), np.ones(4), reasons == 0, reasons)
    average = averaged(reading, np.array([[0, 1], [1, 2], [0, 3]]))
    assert average.invalid is not None and average.valid is not None
    expected = [SETTLING, SETTLING | UNCERTAIN_FORCE, 0]
    np.testing.assert_array_equal(average.invalid, expected)
    np.testing.assert_array_equal(average.valid, average.invalid == 0)
