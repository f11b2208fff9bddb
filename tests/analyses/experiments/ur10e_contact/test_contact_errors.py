"""Causes of errors, ranked."""

from wrenchsight.analyses.experiments.ur10e_contact.contact_errors import (
    AS_IT_IS,
    KINDS,
    largest_first,
)


def _parts(**rest: float) -> dict[str, dict[str, float | None]]:
    return {
        name: {f"{kind}_rmse_n": value if kind == "rest" else None for kind in KINDS}
        for name, value in rest.items()
    }


def test_causes_stand_in_order_of_what_they_change() -> None:
    parts = _parts(
        **{AS_IT_IS: 5.0},
        friction=9.0,
        masses=4.5,
        constant=6.0,
        joint_1_known=4.0,
        joint_2_known=5.5,
    )
    wrong = [("friction", 4.0), ("constant", 1.0), ("masses", -0.5)]
    assert largest_first(parts, "rest", known=False) == wrong
    assert largest_first(parts, "rest", known=True) == [
        ("joint_1_known", 1.0),
        ("joint_2_known", -0.5),
    ]


def test_a_kind_without_intervals_has_no_causes() -> None:
    assert largest_first(_parts(**{AS_IT_IS: 5.0}), "ramp_slide", known=False) == []
