"""Words for figures."""

import pytest

from wrenchsight.analyses.study.wording import change, change_between, compared, listed


def test_a_reduction_is_less_or_more():
    assert change(12.34) == "12.3 % less"
    assert change(-12.34, 0) == "12 % more"
    assert change(0.04) == "no less"
    assert change_between(4.0, 3.0) == "25 % less"
    assert change_between(4.0, 5.0) == "25 % more"


@pytest.mark.parametrize(("value", "word"), [(0.9, "below"), (1.1, "above"), (1.04, "near")])
def test_a_value_is_below_above_or_near(value, word):
    assert compared(value, 1.0, "below", "above", "near", 0.05) == word


def test_words_are_listed():
    assert listed("ab") == "a and b"
    assert listed("abc") == "a, b and c"
    assert listed("a") == "a"
    assert listed([]) == "none"
