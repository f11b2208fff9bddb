"""Which link a contact is on, against closed forms: lines in space, and densities written out."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from wrenchsight.models.detection import link_odds
from wrenchsight.models.detection.link_odds import (
    AT_WORK,
    HOUSING_OVERHANG,
    SURFACE_RADII,
    PlaceOdds,
    axis_feet,
    place_evidence,
)
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


def test_the_feet_of_an_axis_are_nearest_to_its_neighbours(J: np.ndarray) -> None:
    first, last = axis_feet(J)
    axis, through = J[:3].T, np.cross(J[:3].T, J[3:].T)  # a point of each axis
    for k in range(6):
        across = last[k] - first[k + 1]
        for joint, foot in ((k, last[k]), (k + 1, first[k + 1])):
            assert np.linalg.norm(np.cross(foot - through[joint], axis[joint])) < 1e-12
            assert abs(across @ axis[joint]) < 1e-12
    # Of the Panda: upper arm and forearm, the elbow's and the wrist's offset, the flange (m).
    lengths = np.linalg.norm(last - first, axis=1)
    np.testing.assert_allclose(lengths[[2, 4, 6]], [0.316, 0.384, 0.107], atol=1e-9)
    np.testing.assert_allclose(lengths[[0, 1, 3, 5]], 0.0, atol=1e-9)
    offsets = np.linalg.norm(last[:6] - first[1:], axis=1)
    np.testing.assert_allclose(offsets, [0.0, 0.0, 0.0825, 0.0825, 0.0, 0.088], atol=1e-9)


def test_parallel_axes_have_the_foot_of_the_point_before(ur10e: Robot) -> None:
    J = ur10e.chain.jacobian(np.array([0.3, -1.2, 1.4, -1.0, 1.2, 0.2]))
    (first, last), axis = axis_feet(J), J[:3].T
    for k in (1, 2):  # elbow and first wrist: axes 2, 3 and 4 of this arm are parallel
        on_next = np.cross(axis[k + 1], J[3:, k + 1])
        assert np.linalg.norm(np.cross(first[k + 1] - on_next, axis[k + 1])) < 1e-12
        assert abs((first[k + 1] - last[k]) @ axis[k + 1]) < 1e-12


def test_the_surface_lies_around_axes_and_the_lines_between_them(J: np.ndarray) -> None:
    first, last = axis_feet(J)
    for k, surface in enumerate(link_odds._surfaces(J)):
        assert surface.weight.sum() == pytest.approx(1.0)
        assert (surface.weight >= -1e-15).all()
        np.testing.assert_allclose(np.linalg.norm(surface.normal, axis=1), 1.0)
        ends = [(first[k], last[k]), (last[k], first[k + 1] if k < 6 else np.zeros(3))]
        ends += [(first[k + 1], last[k + 1])] if k < 6 else []
        distance = np.min([_apart(surface.point, *pair) for pair in ends], axis=0)
        assert distance.max() < HOUSING_OVERHANG + float(np.mean(SURFACE_RADII))  # the rim of a cap


def _apart(point: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(M,) m of (M, 3) from a line that ends at two points."""
    along = end - begin
    share = (point - begin) @ along / max(float(along @ along), 1e-12)
    nearest = begin + np.clip(share, 0.0, 1.0)[:, None] * along
    return np.asarray(np.linalg.norm(point - nearest, axis=1))


def test_two_links_share_the_axis_between_them(J: np.ndarray) -> None:
    """Near its begin it is of the one, near its end of the other, in all as much of either."""
    first, last = axis_feet(J)
    u = (last[4] - first[4]) / np.linalg.norm(last[4] - first[4])  # along the forearm
    for k, rising in ((3, False), (4, True)):
        surface = link_odds._surfaces(J)[k]
        around = np.linalg.norm(np.cross(surface.point - first[4], u), axis=1)
        along = (surface.point - first[4]) @ u
        tube = (np.abs(around - 0.08) < 0.03) & (np.abs(surface.normal @ u) < 1e-9)
        tube &= (along > 0.05) & (along < 0.33)
        order = np.argsort(along[tube])
        weight = surface.weight[tube][order].reshape(-1, 8).sum(axis=1)
        assert (np.diff(weight if rising else -weight) > 0.0).all()


def test_a_push_along_the_normal_leaves_the_lines_own_axis_alone(J: np.ndarray) -> None:
    """Anywhere on the patch: it turns about the axis with its point."""
    first, last = axis_feet(J)
    u = (last[6] - first[6]) / np.linalg.norm(last[6] - first[6])
    surface = link_odds._surfaces(J)[6]
    side = np.abs(surface.normal @ u) < 1e-9
    B = link_odds._on_link(J, 6, surface)[side]
    np.testing.assert_allclose(B[:, [0, 3, 4], 6], 0.0, atol=1e-12)
    assert np.abs(B[:, 1:3, 6]).max() > 0.01  # a tangent does load it


@pytest.mark.parametrize("f", [0.0, 0.5, -0.5])
def test_where_joint_7_is_silent_link_6_stays_possible(J: np.ndarray, f: float) -> None:
    """A push whose line meets axis 7 between the feet: of link 6, of 7, or at E."""
    first, last = axis_feet(J)
    point = 0.5 * (first[6] + last[6])
    push = 15.0 * np.array([f, np.sqrt(1.0 - f * f), 0.0])
    push -= J[:3, 6] * (J[:3, 6] @ push)
    tau = pushed(J, 7, point, push)
    assert abs(tau[6]) < 1e-12
    odds = odds_of(J, tau)
    assert {6, 7} <= set(odds.named())
    assert 0.1 < odds.bodies[6] < 0.9


def test_odds_have_the_stated_prior() -> None:
    nothing = np.zeros(8)
    np.testing.assert_allclose(PlaceOdds.of(nothing).links, 1.0 / 8.0)
    assert PlaceOdds.of(nothing).at_E == pytest.approx(1.0 / 8.0)
    assert PlaceOdds.of(nothing, AT_WORK).at_E == pytest.approx(AT_WORK)
    evidence = np.log(np.arange(1.0, 9.0))
    np.testing.assert_allclose(PlaceOdds.of(evidence).links, np.arange(1.0, 8.0) / 36.0)


@pytest.mark.parametrize("link", [2, 3, 4, 5, 6, 7])
def test_the_pressed_link_is_named(J: np.ndarray, link: int) -> None:
    ends = np.vstack([axis_feet(J)[0], np.zeros(3)])
    begin, along = ends[link - 1], ends[link] - ends[link - 1]
    u = along / np.linalg.norm(along) if np.linalg.norm(along) > 1e-6 else J[:3, link - 1]
    # Of all pushes against the link the one that loads its own joint most: statics tells it.
    rng, best = np.random.default_rng(0), np.zeros(7)
    for _ in range(50):
        side = np.cross(u, rng.normal(size=3))
        side /= np.linalg.norm(side)
        tau = pushed(J, link, begin + 0.7 * along + 0.08 * side, -15.0 * side)
        best = max(best, tau, key=lambda joint_torques: abs(joint_torques[link - 1]))
    odds = odds_of(J, best)
    assert link in odds.named()
    assert len(odds.named()) <= 3
    assert odds.links.sum() + odds.at_E == pytest.approx(1.0)
    if link == 6:  # a push that loads joint 6 most meets axis 7: statics cannot tell 6 from 7
        assert odds.bodies[5:].sum() > 0.95
    else:
        assert odds.on_link == (link < 7)


@pytest.mark.parametrize("place", [0, 3, 7])
def test_a_prismatic_joint_leaves_the_others_their_links(J: np.ndarray, place: int) -> None:
    wider = np.insert(J, place, [0.0, 0.0, 0.0, 0.0, 0.0, 1.0], axis=1)
    others = np.delete(np.arange(8), place)
    feet = np.stack(axis_feet(wider))
    if place in (0, 7):  # elsewhere a link's end may be another: where the slide lies is not known
        np.testing.assert_allclose(feet[1, others][:6], axis_feet(J)[1][:6], atol=1e-12)
    assert np.isfinite(feet).all()
    assert not odds_of(wider, wider[3:].T @ np.array([3.0, -8.0, -12.0])).on_link
    elbow = int(others[3])  # 0-based
    end = 0.5 * (feet[1, elbow] + feet[0, elbow + 1])
    odds = odds_of(wider, pushed(wider, elbow + 1, end, np.array([14.0, 3.0, -4.0])))
    assert odds.on_link
    assert elbow + 1 in odds.named()


def test_a_force_at_e_is_at_e(J: np.ndarray) -> None:
    odds = odds_of(J, J[3:].T @ np.array([3.0, -8.0, -12.0]))
    assert not odds.on_link
    assert odds.at_E > 0.5
    assert odds.named()[0] == 7


def test_the_touched_link_is_the_likeliest_before_the_last() -> None:
    """Even where the last link alone, with E, is likelier than any other one."""
    assert PlaceOdds(np.array([0.05, 0.25, 0.25, 0.3]), 0.15).touched_link == 2
    many = PlaceOdds(np.append(np.full(11, 0.08), 0.12), 0.0)  # none of them is named
    assert many.on_link
    assert many.touched_link == 1
    assert PlaceOdds(np.array([0.1, 0.2, 0.1, 0.3]), 0.3).touched_link == 0


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
    log_likelihood = link_odds._log_likelihood(B, y, inwards=True)
    for m in range(3):
        for k, F in enumerate(link_odds.FORCE_SIZES):
            C = np.eye(5) + F**2 * B[m].T @ B[m]
            alone = multivariate_normal(np.zeros(5)).logpdf(y)
            expected = multivariate_normal(cov=C).logpdf(y) - alone
            with_force = F**2 * B[m][0] @ np.linalg.inv(C)  # covariance of normal force and y
            mean = with_force @ y
            variance = F**2 - F**2 * with_force @ B[m][0]
            expected += np.log(2.0) + norm.logcdf(mean / np.sqrt(variance))
            assert log_likelihood[m, k] == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_values_that_are_not_finite_are_refused(J: np.ndarray) -> None:
    tau = np.zeros((1, 7))
    tau[0, 3] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        place_evidence(J[None], tau, np.ones((1, 7)))
    with pytest.raises(ValueError, match="expected J"):
        place_evidence(J[None], np.zeros((2, 7)), np.ones((2, 7)))
