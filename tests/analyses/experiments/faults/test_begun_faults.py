"""Faults that begin in a log change what their names say; pushes have the course of theirs."""

import numpy as np
import pytest

from wrenchsight.analyses.experiments.faults.begun_faults import (
    BEGUN_FAULTS,
    COURSES,
    FORCE_LIMITS,
    MAX_LEVER,
    push,
)

T = 0.01  # s
SPAN = slice(200, 300)
CURRENT = np.arange(1.0, 7.0) + T * np.arange(500)[:, None]  # grows evenly


@pytest.mark.parametrize("kind", BEGUN_FAULTS)
def test_every_fault_changes_the_currents_of_its_span(kind: str) -> None:
    for fault in BEGUN_FAULTS[kind]:
        before = CURRENT.copy()
        wrong = fault(CURRENT, SPAN, T)
        assert wrong.shape == (100, 6)
        assert not np.array_equal(wrong, CURRENT[SPAN])
        np.testing.assert_array_equal(CURRENT, before)


def test_sizes() -> None:
    of_first_joint = {kind: faults[0](CURRENT, SPAN, T) for kind, faults in BEGUN_FAULTS.items()}
    right = CURRENT[SPAN]
    np.testing.assert_allclose(of_first_joint["late_500_ms"], right - 0.5)
    np.testing.assert_allclose(of_first_joint["early_500_ms"], right + 0.5)
    np.testing.assert_allclose(of_first_joint["sign"][:, 0], -right[:, 0])
    np.testing.assert_allclose(of_first_joint["offset"][:, 0], right[:, 0] + 2.5)
    np.testing.assert_allclose(of_first_joint["drift"][-1, 0], right[-1, 0] + 99 * T)
    np.testing.assert_array_equal(of_first_joint["exchanged"][:, [1, 0]], right[:, [0, 1]])
    np.testing.assert_array_equal(of_first_joint["doubled"][:, 1:], right[:, 1:])


@pytest.mark.parametrize("seed", range(2 * len(COURSES)))
def test_pushes(seed: int) -> None:
    drawn = push(seed, 400, T)
    assert drawn.course == COURSES[seed % len(COURSES)]
    assert np.linalg.norm(drawn.lever) <= MAX_LEVER
    sizes = np.linalg.norm(drawn.force, axis=1)
    assert sizes[0] == sizes[-1] == 0.0
    if drawn.course in ("held", "growing", "turning"):
        assert FORCE_LIMITS[0] <= sizes.max() <= FORCE_LIMITS[1]
    moment = np.cross(drawn.lever, drawn.force[150])
    np.testing.assert_allclose(drawn.wrench[150], [*moment, *drawn.force[150]])
