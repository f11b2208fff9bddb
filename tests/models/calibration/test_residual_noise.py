"""The residual's covariance: written out by hand, its square root, and what a rest does to it."""

import numpy as np
import pytest

from wrenchsight.models.calibration import residual_noise
from wrenchsight.models.calibration.residual_noise import DEPENDENT_ROWS, V_REST, ResidualRows


def rows(m=40, n=2, seed=0, **changes):
    rng = np.random.default_rng(seed)
    parts = {
        "t": np.arange(m) * 0.1,
        "v": 0.2 + rng.random((m, n)),
        "residual": rng.normal(size=(m, n)),
        "dry": rng.normal(size=(m, n)),
        "viscous": rng.normal(size=(m, n)),
        "stiction": np.full((m, n), 6.0),
        "sliding": rng.normal(size=(m, n, 3)),
        "sd": np.array([1.0, 2.0])[:n],
    }
    return ResidualRows(**parts | changes)


def test_covariance_by_hand(monkeypatch):
    two_rows = ResidualRows(
        t=np.array([0.0, 0.3]),
        v=np.array([[0.5], [-0.04]]),
        residual=np.zeros((2, 1)),
        dry=np.array([[6.0], [-5.0]]),
        viscous=np.array([[2.0], [-0.2]]),
        stiction=np.array([[7.0], [7.0]]),
        sliding=np.zeros((2, 1, 3)),
        sd=np.array([1.5]),
    )
    shares = {"WHITE_SHARE": 0.5, "REVERSAL_RATIO": 3.0, "COULOMB_SHARE": 0.03}
    shares["CORRELATION_TIME"] = 0.4
    for name, share in shares.items():
        monkeypatch.setattr(residual_noise, name, share)
    reversal = 1.0 + 3.0 * np.exp(-((np.array([0.5, 0.04]) / 0.08) ** 2))
    white = (0.5 * 1.5 * reversal) ** 2
    slow = (0.6 * 1.5) ** 2
    variance_0 = slow + (0.03 * 6.0) ** 2 + (0.05 * 2.0) ** 2 + white[0]
    variance_1 = slow + (0.03 * 5.0) ** 2 + (0.05 * 0.2) ** 2 + white[1]
    covariance_01 = (slow - 0.03**2 * 6.0 * 5.0 - 0.05**2 * 2.0 * 0.2) * np.exp(-0.3 / 0.4)
    np.testing.assert_allclose(
        two_rows.covariance(0), [[variance_0, covariance_01], [covariance_01, variance_1]]
    )


def test_whitening_is_a_square_root_of_the_inverse_covariance():
    residual_rows = rows()
    W = residual_rows.whitened(1, np.eye(len(residual_rows.t)))
    np.testing.assert_allclose(
        W[:, :-1].T @ W[:, :-1] @ residual_rows.covariance(1), np.eye(40), atol=1e-9
    )
    np.testing.assert_allclose(W[:, -1], W[:, :-1] @ residual_rows.residual[:, 1])


def test_a_rest_holds_one_unknown_torque():
    v = np.full((9, 1), 0.3)
    v[2:4] = v[6:8] = 0.2 * V_REST  # two rests, a motion between them
    residual_rows, moving = rows(9, 1, v=v), rows(9, 1, v=np.where(v < V_REST, V_REST, v))
    held = residual_rows.covariance(0) - moving.covariance(0)
    expected = np.zeros((9, 9))
    expected[2:4, 2:4] = expected[6:8, 6:8] = 6.0**2 / 3.0
    # 2 %: at a fifth of V_REST white is larger by exp(-(v / v_r)^2), a little.
    np.testing.assert_allclose(held, expected, atol=0.02 * 12.0)


def test_dry_level_is_that_of_motion():
    v = np.array([[0.5, 0.0], [0.0, 0.0], [-0.5, 0.0]])
    dry = np.array([[3.0, 0.5], [0.1, 2.0], [-4.0, 1.0]])
    residual_rows = rows(3, 2, v=v, dry=dry)
    # The second joint never moves: what is known of its friction is the stiction.
    np.testing.assert_allclose(residual_rows.dry_level, [np.sqrt((9.0 + 16.0) / 2.0), 6.0])
    np.testing.assert_allclose(residual_rows.moving_share, [2.0 / 3.0, 0.0])


def test_at_rest_only_the_offset_can_drift():
    v = np.array([[0.5, 0.0], [0.2 * V_REST, 0.3]])
    residual_rows = rows(2, 2, v=v)
    np.testing.assert_array_equal(residual_rows.drift[0, 0], residual_rows.sliding[0, 0])
    np.testing.assert_array_equal(
        residual_rows.drift[1, 0], [0.0, 0.0, residual_rows.sliding[1, 0, 2]]
    )
    np.testing.assert_array_equal(
        residual_rows.drift[0, 1], [0.0, 0.0, residual_rows.sliding[0, 1, 2]]
    )


def test_long_logs_are_taken_block_by_block():
    residual_rows = rows(DEPENDENT_ROWS + 50)
    none = np.zeros((DEPENDENT_ROWS + 50, 0))
    whole = residual_rows.whitened(0, none)[:, 0]
    parts = [
        residual_rows[part].whitened(0, none[part])[:, 0]
        for part in (slice(0, DEPENDENT_ROWS), slice(DEPENDENT_ROWS, None))
    ]
    np.testing.assert_allclose(whole, np.concatenate(parts))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t": np.zeros(40)}, "rise"),
        ({"t": np.arange(39.0)}, "expected t"),
        ({"sliding": np.zeros((40, 2, 2))}, "expected t"),
        ({"sd": np.array([1.0, 0.0])}, "positive"),
        ({"residual": np.full((40, 2), np.nan)}, "finite"),
    ],
)
def test_invalid_rows_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        rows(**changes)


def test_rows_of_two_logs_are_independent_and_rest_apart():
    """A joint that rests at the end of one log and at the start of the next rests twice."""
    v = np.full((40, 2), V_REST / 2.0)
    log, other_log = rows(v=v), rows(seed=1, v=v)
    joined = ResidualRows.joined([log, other_log])
    assert (np.diff(joined.t) > 0.0).all()
    covariance = joined.covariance(0)
    np.testing.assert_allclose(covariance[:40, :40], log.covariance(0))
    np.testing.assert_allclose(covariance[40:, 40:], other_log.covariance(0))
    np.testing.assert_allclose(covariance[:40, 40:], 0.0, atol=1e-9)
