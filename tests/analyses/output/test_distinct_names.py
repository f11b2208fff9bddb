"""Names of results: of a repeated one each further gets a number."""

from wrenchsight.analyses.output.distinct_names import distinct_names


def test_a_repeated_name_gets_the_next_number_that_is_free() -> None:
    assert distinct_names(["a", "b", "a", "a"]) == ["a", "b", "a_2", "a_3"]
    assert distinct_names(["a", "a_2", "a"]) == ["a", "a_2", "a_3"]
    assert distinct_names(["a", "a", "a_2"]) == ["a", "a_2", "a_2_2"]
    assert distinct_names([]) == []
