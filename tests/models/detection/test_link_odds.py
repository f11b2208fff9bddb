"""Which link a contact is on, against closed forms: lines in space, and densities written out."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from wrenchsight.models.detection import link_odds
from wrenchsight.models.detection.link_odds import PlaceOdds, link_ends, place_evidence
from wrenchsight.models.robot.robot import Robot

POSTURE = [0.062, 0.688, -0.079, -1.621, 0.028, 2.288, 0.847]  # rad
SD = 0.05  # N m


@pytest.fixture(scope="module")
def J() -> np.ndarray:
    return Robot.load("panda").chain.jacobian(np.array(POSTURE))


def pushed(J: np.ndarray, link: int, point: np.ndarray, force: np.ndarray) -> np.ndarray:
    """(n,) N m of a force at a point, m from E, of link 1 to n."""
    tau = (J[3:].T + np.cross(J[:3].T, point)) @ force
    tau[link:] = 0.0
    return tau


def odds_of(J: np.ndarray, tau: np.ndarray, sd: float = SD) -> PlaceOdds:
    return PlaceOdds.of(place_evidence(J[None], tau[None], np.full((1, len(tau)), sd)))


def test_a_link_ends_midway_between_its_axis_and_the_next(J: np.ndarray) -> None:
    ends, axis = link_ends(J), J[:3].T
    through = np.cross(axis, J[3:].T)  # a point of each axis
    for k in range(6):
        a, b = axis[k], axis[k + 1]
        across = np.cross(a, b)
        apart = abs((through[k + 1] - through[k]) @ across) / np.linalg.norm(across)
        for own in (k, k + 1):
            distance = np.linalg.norm(np.cross(ends[k] - through[own], axis[own]))
            assert distance == pytest.approx(0.5 * apart, abs=1e-12)
    np.testing.assert_array_equal(ends[6], 0.0)


def test_parallel_axes_end_a_link_at_the_nearest_point_of_the_next(ur10e: Robot) -> None:
    J = ur10e.chain.jacobian(np.array([0.3, -1.2, 1.4, -1.0, 1.2, 0.2]))
    ends, axis = link_ends(J), J[:3].T
    for k in (1, 2):  # elbow and first wrist: axes 2, 3 and 4 of this arm are parallel
        on_next = np.cross(axis[k + 1], J[3:, k + 1])
        assert np.linalg.norm(np.cross(ends[k] - on_next, axis[k + 1])) < 1e-12
        assert abs((ends[k] - ends[k - 1]) @ axis[k + 1]) < 1e-12


@pytest.mark.parametrize("link", [2, 3, 4, 5, 6, 7])
def test_the_pressed_link_is_named(J: np.ndarray, link: int) -> None:
    ends = link_ends(J)
    begin, along = ends[link - 2], ends[link - 1] - ends[link - 2]
    u = along / np.linalg.norm(along) if np.linalg.norm(along) > 1e-6 else J[:3, link - 1]
    # Of all pushes against the link the one that loads its own joint most: statics tells it.
    rng, best = np.random.default_rng(0), np.zeros(7)
    for _ in range(50):
        side = np.cross(u, rng.normal(size=3))
        side /= np.linalg.norm(side)
        tau = pushed(J, link, begin + 0.7 * along + 0.08 * side, -15.0 * side)
        best = max(best, tau, key=lambda own: abs(own[link - 1]))
    odds = odds_of(J, best)
    assert link in odds.named()
    assert len(odds.named()) <= 3
    assert odds.links.sum() + odds.at_E == pytest.approx(1.0)
    assert odds.on_link == (link < 7)


@pytest.mark.parametrize("place", [0, 3, 7])
def test_a_prismatic_joint_leaves_the_others_their_links(J: np.ndarray, place: int) -> None:
    wider = np.insert(J, place, [0.0, 0.0, 0.0, 0.0, 0.0, 1.0], axis=1)
    others = np.delete(np.arange(8), place)
    if place in (0, 7):  # elsewhere a link's end may be another: where the slide lies is not known
        np.testing.assert_allclose(link_ends(wider)[others][:6], link_ends(J)[:6], atol=1e-12)
    assert np.isfinite(link_ends(wider)).all()
    assert not odds_of(wider, wider[3:].T @ np.array([3.0, -8.0, -12.0])).on_link
    elbow = int(others[3])  # 0-based
    end = link_ends(wider)[elbow]
    odds = odds_of(wider, pushed(wider, elbow + 1, end, np.array([14.0, 3.0, -4.0])))
    assert odds.on_link
    assert elbow + 1 in odds.named()


def test_a_force_at_e_is_at_e(J: np.ndarray) -> None:
    odds = odds_of(J, J[3:].T @ np.array([3.0, -8.0, -12.0]))
    assert not odds.on_link
    assert odds.at_E > 0.5
    assert odds.named()[0] == 7


def test_a_loaded_joint_rules_out_the_links_before_it(J: np.ndarray) -> None:
    tau = np.array([-10.0, 2.0, -8.0, -1.0, 0.0, 0.0, 0.0])
    free = place_evidence(J[None], tau[None], np.full((1, 7), SD), loaded=1.5)
    assert np.isneginf(free[:3]).all()
    assert np.isfinite(free[3:]).all()
    tau[5] = 0.4
    assert min(odds_of(J, tau).named()) >= 6


def test_the_evidence_is_that_of_the_densities_written_out() -> None:
    rng = np.random.default_rng(5)
    B, y = rng.normal(size=(3, 4, 5)), rng.normal(size=5)
    found = link_odds._log_likelihood(B, y, inwards=True)
    for m in range(3):
        for k, F in enumerate(link_odds.SIZES):
            C = np.eye(5) + F**2 * B[m].T @ B[m]
            alone = multivariate_normal(np.zeros(5)).logpdf(y)
            expected = multivariate_normal(cov=C).logpdf(y) - alone
            with_force = F**2 * B[m][0] @ np.linalg.inv(C)  # covariance of normal force and y
            mean = with_force @ y
            variance = F**2 - F**2 * with_force @ B[m][0]
            expected += np.log(2.0) + norm.logcdf(mean / np.sqrt(variance))
            assert found[m, k] == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_what_is_not_finite_is_refused(J: np.ndarray) -> None:
    tau = np.zeros((1, 7))
    tau[0, 3] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        place_evidence(J[None], tau, np.ones((1, 7)))
    with pytest.raises(ValueError, match="expected J"):
        place_evidence(J[None], np.zeros((2, 7)), np.ones((2, 7)))
