"""Words without a sign are told from numbers; a wrong claim is worse than a missed one."""

import numpy as np
import pytest

from wrenchsight.models.recordings.plausibility.raw_words import RawWords, raw_words

ROWS = 400


def swings(amplitude: float, turns: float, columns: int = 3) -> np.ndarray:
    """(ROWS, columns) whole numbers about zero."""
    angle = 2.0 * np.pi * turns * np.linspace(0.0, 1.0, ROWS)
    return np.rint(amplitude * np.sin(angle[:, None] + np.arange(columns)))


def twos_complement(numbers: np.ndarray) -> np.ndarray:
    return np.where(numbers < 0, numbers + 65536, numbers)


@pytest.mark.parametrize(
    ("encoding", "words"),
    [
        ("twos_complement", twos_complement),
        ("sign_bit", lambda x: np.where(x < 0, 32768 - x, x)),
    ],
)
def test_words_whose_numbers_swing_about_zero_are_found(encoding, words):
    assert raw_words(words(swings(900.0, 3.0))) == RawWords(encoding, 16)


def test_one_joint_that_moves_there_and_back_is_enough():
    numbers = np.c_[swings(900.0, 1.0, 1), np.full(ROWS, 40.0)]
    assert raw_words(twos_complement(numbers)) == RawWords("twos_complement", 16)


def test_numbers_without_a_sign_that_step_once_in_each_column_are_no_words():
    """As when the drives are switched on."""
    is_on = np.arange(ROWS)[:, None] >= np.array([100, 120, 140])
    numbers = np.where(is_on, 251.0, 3.0) + np.arange(ROWS)[:, None] % 3
    assert raw_words(numbers) is None


@pytest.mark.parametrize(
    "numbers",
    [
        swings(900.0, 3.0),
        0.5 * np.abs(swings(901.0, 3.0)),
        np.abs(swings(900.0, 3.0)),
        120.0 + swings(120.0, 3.0),
        np.random.default_rng(1).integers(0, 256, (ROWS, 3)).astype(float),
        np.empty((0, 3)),
    ],
    ids=["signed", "halves", "magnitudes", "with an offset", "at random", "none"],
)
def test_other_numbers_are_no_words(numbers):
    assert raw_words(numbers) is None
