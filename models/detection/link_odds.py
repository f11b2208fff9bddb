"""Odds of a contact's place, a link or the tool, from joint torques alone.

A force f at a point P of link k loads joints 1 to k by J_P^T f, and no joint beyond. Compared are

    link k  one force at one point of its surface, anywhere on it, directed inwards: the component
            along the normal positive, those across it TANGENT_SHARE times as large
    E       a force at E, with a moment of one of FORCE_LEVERS times its size: none, or a tool's

each by its marginal likelihood, over force, point and size,

    p(tau | place) = mean over points and sizes of N(tau; 0, F^2 B^T B + Sigma) 2 Phi(f_n / sd(f_n))

with B = S^(1/2) J_P, S the shares of normal and tangent, and F one of FORCE_SIZES. Each point
stands for a patch of the surface: the changes of a push anywhere on it are two more rows of B. A
place that could cause many other torques has a lower likelihood. So the narrowest place that
explains the torques wins, without a further constant: an unloaded joint beyond the touched link
counts by its sd. All samples of a contact share one point. Their log likelihoods count as one
sample, since the errors of an arm are correlated over a contact. Where the mean of a joint's torque
exceeds LOADED_SDS times its sd, the links before that joint are excluded.

**Shape.** Nothing but the Jacobian is needed. The arm is a chain of its axes and of the lines from
one axis to the next. An axis extends between its feet, the points nearest to the previous and to
the next axis; of parallel axes it is the foot of the previous point. A line belongs to the link
between both axes. The housing of a joint lies along its axis, HOUSING_OVERHANG beyond both feet.
The Jacobian does not determine where on the housing one link ends and the next begins: anywhere
between the feet is as likely, and where these coincide every point belongs to either link. So link
6 of an arm may also be touched around axis 7, where joint 7 is not loaded. The surface lies at
SURFACE_RADII, alternating, around axis or line, with a cap at both ends of a housing. A point of it
counts by its area and by the probability that it belongs to the link. A push that turns about the
line with its point causes no torque about that line.

**Error.** Sigma = D R D, with R the correlation of the joints' errors. D^2 is the sum of three
squares: of each joint's sd, of GAIN_ERROR_SHARE times its torque and of CROSS_ERROR_SHARE times the
largest torque. The second stands for an error of the joint's gain. The third stands for an error of
the axis in the model and for friction of its bearing.

Every J is (6, n), rows [angular; linear] at E in axes of W; all joints revolute.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr, logsumexp

from wrenchsight.models.estimation.wrench_prior import PRIOR_LEVER
from wrenchsight.models.numerics.arrays import Array, Flags

SURFACE_RADII = (0.06, 0.1)  # m
HOUSING_OVERHANG = 0.08  # m
TANGENT_SHARE = 0.3
FORCE_LEVERS = (0.0, PRIOR_LEVER)  # m
FORCE_SIZES = (3.0, 10.0, 30.0, 100.0)  # N
GAIN_ERROR_SHARE, CROSS_ERROR_SHARE = 0.03, 0.01
LOADED_SDS = 3.0  # times its sd; a larger torque of a joint is no error
AT_WORK = 0.5  # prior odds of E, of an arm that works with its tool
MAX_LINK_ODDS = 0.1  # largest odds of a link that leave a reading at E valid
MIN_NAMED_ODDS = 0.1  # least odds of a link that is named
MAX_NAMED_LINKS = 3
_POINTS_ALONG, _POINTS_AROUND = 5, 8
_PARALLEL_SINE2 = 1e-3  # squared sine of the angle between axes
_MIN_LINE_LENGTH = 1e-6  # m; a shorter line has no direction
_MIN_SIDE_SINE = 0.1  # of the angle between a line and its `side`; less, and an axis of W stands in
_UNIFORM_SD = 1.0 / np.sqrt(12.0)  # of a uniform distribution over a length of 1


class PlaceOdds(NamedTuple):
    """Odds of a contact's place; they add up to 1.

    Attributes:
        links: (n,) of a force on link 1 to n.
        at_E: odds of a force at E.
    """

    links: Array
    at_E: float

    @classmethod
    def of(cls, evidence: Array, at_E: float | None = None) -> "PlaceOdds":
        """Returns the odds from log likelihoods.

        Args:
            evidence: (n + 1,) of link 1 to n and of E, of `place_evidence`.
            at_E: prior odds of E; the links share 1 - at_E. None: E and every link are as likely.
        """
        n = len(evidence) - 1
        prior_E = 1.0 / (n + 1) if at_E is None else at_E
        prior = np.append(np.full(n, (1.0 - prior_E) / n), prior_E)
        log = np.asarray(evidence) + np.log(prior)
        odds = np.exp(log - logsumexp(log))
        return cls(odds[:n], float(odds[n]))

    @property
    def on_link(self) -> bool:
        """Whether a link before the last one, which carries E, is likelier than the last and E."""
        return bool(self.links[:-1].sum() > 0.5)

    @property
    def touched_link(self) -> int:
        """The likeliest link before the last, 1 to n - 1, of a contact `on_link`; 0 of others."""
        return int(np.argmax(self.links[:-1])) + 1 if self.on_link else 0

    @property
    def bodies(self) -> Array:
        """(n,) odds of each link as a body: E counts for the last one, which carries it."""
        bodies = self.links.copy()
        bodies[-1] += self.at_E
        return bodies

    def named(self) -> list[int]:
        """The links, 1 to n, of odds MIN_NAMED_ODDS or more, likeliest first: MAX_NAMED_LINKS at
        most.
        """
        bodies = self.bodies
        order = np.argsort(-bodies, kind="stable")[:MAX_NAMED_LINKS]
        return [int(k) + 1 for k in order if bodies[k] >= MIN_NAMED_ODDS]


def place_evidence(
    J: ArrayLike,
    tau_ext: ArrayLike,
    sd: ArrayLike,
    correlation: ArrayLike | None = None,
    loaded: float = LOADED_SDS,
) -> Array:
    """Log likelihoods (n + 1,) of link 1 to n and of E for one contact, up to a common constant.

    A place is made of points, each with a weight, and the force has one of FORCE_SIZES:

        log p(place) = log sum over points and sizes of weight / sizes * exp(mean over samples of
                       log N(tau; 0, D R D + size^2 B^T B))

    B are the torques of unit forces at the point; on a link the likelihood has the factor of this
    module for a force inwards, too. Links before the last loaded joint have -inf.

    Args:
        J: (K, 6, n) of K samples of it.
        tau_ext: (K, n) N m, of the contact alone: less the torque estimated without it.
        sd: (K, n) N m of its error.
        correlation: (n, n) R of the errors of the joints; None: they are independent.
        loaded: sds, beyond which the mean of a joint's torque is no error.

    Raises:
        ValueError: shapes disagree, or a value is not finite.
    """
    J, tau, sd = (np.asarray(x, float) for x in (J, tau_ext, sd))
    K, n = tau.shape
    if J.shape != (K, 6, n) or sd.shape != (K, n) or not K:
        raise ValueError(f"expected J (K, 6, n), sd (K, n), not {J.shape} and {sd.shape}")
    if not (np.isfinite(J).all() and np.isfinite(tau).all() and np.isfinite(sd).all()):
        raise ValueError("place_evidence: a sample is not finite")
    R = np.eye(n) if correlation is None else np.asarray(correlation, float)
    largest = np.abs(tau).max(axis=1, keepdims=True)
    D = np.sqrt(sd**2 + (GAIN_ERROR_SHARE * tau) ** 2 + (CROSS_ERROR_SHARE * largest) ** 2)
    loaded_joints = np.flatnonzero(np.abs(np.mean(tau / D, axis=0)) > loaded)
    # Counted from 0: joint j loads when link j or one beyond it is touched.
    first_link = int(loaded_joints[-1]) if len(loaded_joints) else 0
    E = n  # the place after the links
    # By place, then by sample: (points, sizes); a link has as many points in every posture.
    by_sample: list[list[Array]] = [[] for _ in range(n + 1)]
    surfaces_of_samples = [_surfaces(J_k) for J_k in J]
    for J_k, tau_k, D_k, surfaces in zip(J, tau, D, surfaces_of_samples, strict=True):
        whitening = np.linalg.inv(np.linalg.cholesky(D_k[:, None] * R * D_k))
        white_tau = whitening @ tau_k
        for link in range(first_link, n):
            B = _on_link(J_k, link, surfaces[link]) @ whitening.T
            by_sample[link].append(_log_likelihood(B, white_tau, inwards=True))
        B = _at_E(J_k) @ whitening.T
        by_sample[E].append(_log_likelihood(B, white_tau, inwards=False))
    # By place: (points,), those of a link in the last sample, as posture changes little during a
    # contact; at E one for each lever.
    weights = [surface.weight for surface in surfaces_of_samples[-1]]
    weights.append(np.full(len(FORCE_LEVERS), 1.0 / len(FORCE_LEVERS)))
    evidence = np.full(n + 1, -np.inf)  # which stays of the excluded links
    for place in range(first_link, n + 1):
        by_point_and_size = np.mean(by_sample[place], axis=0)
        share = weights[place][:, None] / len(FORCE_SIZES)
        evidence[place] = logsumexp(by_point_and_size, b=share)
    return evidence


def _at_E(J: Array) -> Array:
    """B (levers, 6, n) at E: of unit forces, and of moments of such forces by FORCE_LEVERS."""
    return np.stack([np.concatenate([J[3:], lever * J[:3]]) for lever in FORCE_LEVERS])


class _Surface(NamedTuple):
    """M points of a link's surface, m from E and in axes of W.

    Attributes:
        point, normal: (M, 3), the normal outwards.
        weight: (M,) share of each point in the link's surface; they add up to 1.
        along: (M, 3) moment about the point of a unit force inwards, one sd off along the line.
        around: (M, 2, 3) moment and change of that force, one sd off around the line.
    """

    point: Array
    normal: Array
    weight: Array
    along: Array
    around: Array

    @classmethod
    def of(cls, parts: "list[_Surface]") -> "_Surface":
        """All parts together, the weights scaled so that they add up to 1."""
        joined = cls.joined(parts)
        return joined._replace(weight=joined.weight / joined.weight.sum())

    @classmethod
    def joined(cls, parts: "list[_Surface]") -> "_Surface":
        """All parts together, one after another."""
        return cls._make(np.concatenate(columns) for columns in zip(*parts, strict=True))

    def shared(self, share: Array) -> "_Surface":
        """The surface with its weights times `share` (M,)."""
        return self._replace(weight=self.weight * share)


class _LineSurface(NamedTuple):
    """Surface around a line, and where along it each point is.

    Attributes:
        surface: M points.
        position: (M,) -1/2 at the begin of the line to 1/2 at its end.
    """

    surface: _Surface
    position: Array


class AxisFeet(NamedTuple):
    """Points of n axes, m from E in axes of W.

    Attributes:
        first: (n, 3) nearest to the previous axis.
        last: (n, 3) nearest to the next axis, or to E.
    """

    first: Array
    last: Array


def axis_feet(J: Array) -> AxisFeet:
    """The feet of axis 1 to n: its points nearest to the previous and to the next axis.

    The feet of two neighbours are where their common perpendicular meets them (as in Denavit and
    Hartenberg's parameters). Where there is none, of parallel axes or a prismatic joint, the axis
    has one foot only: the point nearest to the foot before, or to E for the first. The last foot of
    the last axis is its point nearest to E. J does not determine where a prismatic joint lies: its
    foot is the one before, or E.

    Args:
        J: (6, n), rows [angular; linear], at E in axes of W.
    """
    slides = _slides(J)
    axis = np.where(slides, J[3:], J[:3]).T
    axis_point = np.cross(J[:3].T, J[3:].T)  # of each axis, nearest to E
    n = len(axis)

    def on_axis(k: int, point: Array) -> Array:
        """The point of axis k that is nearest to `point`."""
        if slides[k]:
            return point
        return np.asarray(axis_point[k] + axis[k] * float(axis[k] @ (point - axis_point[k])))

    # Entry k: where the common perpendicular of axes k and k + 1 meets them; None: there is none.
    perpendiculars = [
        None if slides[k] or slides[k + 1] else _nearest(axis[k : k + 2], axis_point[k : k + 2])
        for k in range(n - 1)
    ]
    E = np.zeros(3)
    first_foot, last_foot = np.zeros((n, 3)), np.zeros((n, 3))
    for k in range(n):
        to_previous = perpendiculars[k - 1] if k > 0 else None
        to_next = perpendiculars[k] if k < n - 1 else None
        if to_previous is not None:
            first_foot[k] = to_previous.on_second
        elif k > 0:
            first_foot[k] = on_axis(k, last_foot[k - 1])
        elif to_next is not None:
            first_foot[k] = to_next.on_first
        else:
            first_foot[k] = on_axis(k, E)
        if k == n - 1:
            last_foot[k] = on_axis(k, E)
        elif to_next is not None:
            last_foot[k] = to_next.on_first
        else:
            last_foot[k] = first_foot[k]
    return AxisFeet(first_foot, last_foot)


class _NearestPoints(NamedTuple):
    """The points (3,) of two lines that are nearest to each other."""

    on_first: Array
    on_second: Array


def _nearest(axis: Array, point: Array) -> _NearestPoints | None:
    """The nearest points of two lines; None where they are parallel.

    Args:
        axis: (2, 3) unit vectors.
        point: (2, 3) a point of each line.
    """
    (a, b), (p, r) = axis, point
    cosine = float(a @ b)
    sine2 = 1.0 - cosine * cosine
    if sine2 < _PARALLEL_SINE2:
        return None
    apart = p - r
    s = (cosine * float(b @ apart) - float(a @ apart)) / sine2
    u = (float(b @ apart) - cosine * float(a @ apart)) / sine2
    return _NearestPoints(p + s * a, r + u * b)


def _slides(J: Array) -> Flags:
    """(n,) which joints are prismatic, of J (6, n)."""
    return np.asarray(np.linalg.norm(J[:3], axis=0) < 0.5)


def _surfaces(J: Array) -> list[_Surface]:
    """The surfaces of link 1 to n, as points with weights and normals, from the Jacobian alone.

    Each axis has a housing along it, from foot to foot and HOUSING_OVERHANG m beyond, which the
    links on both sides share; a tube leads from a link's last foot to the next axis, or to E.

    Args:
        J: (6, n), rows [angular; linear], at E in axes of W; the points are relative to E.
    """
    axis = np.where(_slides(J), J[3:], J[:3]).T
    first_foot, last_foot = axis_feet(J)
    n = len(axis)
    parts_of_link: list[list[_Surface]] = [[] for _ in range(n)]
    for k in range(n):
        between = last_foot[k] - first_foot[k]
        length = float(np.linalg.norm(between))
        has_length = length > _MIN_LINE_LENGTH
        along_axis = between / length if has_length else axis[k]
        # The ring of points begins at the axis before, and so turns with the arm.
        side = axis[k - 1] if k else np.eye(3)[int(np.argmin(np.abs(along_axis)))]
        # The last axis ends where the tool is, if it leads there.
        end_overhang = 0.0 if k == n - 1 and has_length else HOUSING_OVERHANG
        end = last_foot[k] + end_overhang * along_axis
        housing, position = _housing(first_foot[k] - HOUSING_OVERHANG * along_axis, end, side)
        housing_length = float(np.linalg.norm(end - first_foot[k])) + HOUSING_OVERHANG
        # Probability of link k at each point, else of link k - 1: 1/2 in the middle of the housing
        # (position 0), it rises linearly along it (-1/2 to 1/2), by length / housing_length in all.
        share = 0.5 + length / housing_length * position
        parts_of_link[k].append(housing.shared(share))
        if k:
            parts_of_link[k - 1].append(housing.shared(1.0 - share))
        next_foot = first_foot[k + 1] if k < n - 1 else np.zeros(3)
        if np.linalg.norm(next_foot - last_foot[k]) > _MIN_LINE_LENGTH:
            parts_of_link[k].append(_tube(last_foot[k], next_foot, axis[k]).surface)
    return [_Surface.of(part) for part in parts_of_link]


def _tube(begin: Array, end: Array, side: Array) -> _LineSurface:
    """A tube around the line from `begin` to `end`; its points start at `side`; (3,) each."""
    length = float(np.linalg.norm(end - begin))
    u, ring = _ring(begin, end, side)
    position = (np.arange(_POINTS_ALONG) + 0.5) / _POINTS_ALONG - 0.5
    radius = np.array(
        [np.resize(np.roll(SURFACE_RADII, -(i % 2)), _POINTS_AROUND) for i in range(_POINTS_ALONG)]
    )
    middle = 0.5 * (begin + end) + position[:, None] * (end - begin)
    point = (middle[:, None] + radius[..., None] * ring).reshape(-1, 3)
    normal = np.tile(ring, (_POINTS_ALONG, 1))
    size = len(point)
    angle_sd = 2.0 * np.pi / _POINTS_AROUND * _UNIFORM_SD  # rad, over the patch of a point
    tangent = np.cross(u, normal)
    moment = angle_sd * radius.reshape(-1, 1) * np.cross(tangent, -normal)
    surface = _Surface(
        point=point,
        normal=normal,
        weight=np.full(size, 2.0 * np.pi * float(np.mean(SURFACE_RADII)) * length / size),
        along=length / _POINTS_ALONG * _UNIFORM_SD * np.cross(u, -normal),
        around=np.stack([moment, -angle_sd * tangent], axis=1),
    )
    return _LineSurface(surface, np.repeat(position, _POINTS_AROUND))


def _housing(begin: Array, end: Array, side: Array) -> _LineSurface:
    """A tube with its two caps, each a slanting ring and a face across; arguments as `_tube`."""
    tube, tube_position = _tube(begin, end, side)
    u, ring = _ring(begin, end, side)
    radius = float(np.mean(SURFACE_RADII))
    parts, position = [tube], [tube_position]
    for middle, sign in ((begin, -1.0), (end, 1.0)):
        slant = np.sqrt(0.5) * (ring[::2] + sign * u)
        normal = np.vstack([slant, sign * u])
        point = middle + radius * np.vstack([slant, 0.5 * sign * u])
        count = len(slant)
        weight = 0.5 * np.pi * radius**2 * np.append(np.full(count, 1.0 / count), 1.0)
        reach = radius * _UNIFORM_SD * np.append(np.ones(count), 2.0)[:, None]
        tangent, other_tangent = _across(normal)
        moment = np.stack([reach * other_tangent, np.zeros_like(other_tangent)], axis=1)
        parts.append(_Surface(point, normal, weight, reach * tangent, moment))
        position.append(np.full(count + 1, 0.5 * sign))
    return _LineSurface(_Surface.joined(parts), np.concatenate(position))


class _Ring(NamedTuple):
    """Unit vectors: (3,) along a line, and (_POINTS_AROUND, 3) across it, all around."""

    along: Array
    across: Array


def _ring(begin: Array, end: Array, side: Array) -> _Ring:
    """The unit vectors of the line between two points (3,), those across it from `side` on."""
    u = (end - begin) / float(np.linalg.norm(end - begin))
    if np.linalg.norm(np.cross(u, side)) < _MIN_SIDE_SINE:
        side = np.eye(3)[int(np.argmin(np.abs(u)))]
    e1 = np.cross(u, side) / np.linalg.norm(np.cross(u, side))
    turn = 2.0 * np.pi * np.arange(_POINTS_AROUND)[:, None] / _POINTS_AROUND
    return _Ring(u, np.cos(turn) * e1 + np.sin(turn) * np.cross(u, e1))


class _Tangents(NamedTuple):
    """Two unit vectors (M, 3) across each normal, and across each other."""

    first: Array
    second: Array


def _across(normal: Array) -> _Tangents:
    """The tangents of unit normals (M, 3)."""
    tangent = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)])
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    return _Tangents(tangent, np.cross(normal, tangent))


def _on_link(J: Array, k: int, surface: _Surface) -> Array:
    """B (M, 5, n) of link k (0-based), at M points of its surface.

    Rows: the force inwards, that along two tangents, and the changes of the first one along and
    around the line, over the point's patch.
    """
    tangent, other_tangent = _across(surface.normal)
    zero = np.zeros_like(tangent)
    tangents = [TANGENT_SHARE * tangent, TANGENT_SHARE * other_tangent]
    force = [-surface.normal, *tangents, zero, surface.around[:, 1]]
    moment = [zero, zero, zero, surface.along, surface.around[:, 0]]
    at_point = J[3:].T + np.cross(J[:3].T, surface.point[:, None])  # (M, n, 3)
    B = np.stack(force, axis=1) @ at_point.swapaxes(1, 2) + np.stack(moment, axis=1) @ J[:3]
    B[:, :, k + 1 :] = 0.0
    return np.asarray(B)


def _log_likelihood(B: Array, y: Array, inwards: bool) -> Array:
    """(M, sizes) log N(y; 0, 1 + F^2 B^T B) of M points, up to a constant common to all places.

    Args:
        B: (M, d, n), whitened.
        y: (n,) whitened torque.
        inwards: whether the component of the first row is positive.
    """
    F2 = np.square(FORCE_SIZES)
    values, vectors = np.linalg.eigh(B @ B.swapaxes(1, 2))
    projected = ((B @ y)[:, None] @ vectors)[:, 0]  # (M, d)
    share = 1.0 / (1.0 + F2[:, None] * np.maximum(values, 0.0)[:, None])  # (M, sizes, d)
    log = 0.5 * (F2[:, None] * share * projected[:, None] ** 2 + np.log(share)).sum(axis=2)
    if inwards:
        normal_share = vectors[:, 0]  # (M, d): the normal's row
        mean = (F2[:, None] * share * (normal_share * projected)[:, None]).sum(axis=2)
        variance = (F2[:, None] * share * (normal_share**2)[:, None]).sum(axis=2)
        log = log + np.log(2.0) + log_ndtr(mean / np.sqrt(variance))
    return np.asarray(log)
