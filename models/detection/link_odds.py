"""Odds of a contact's place, a link or the tool, from joint torques alone.

A force f at a point P of link k loads joints 1 to k by J_P^T f, and no joint beyond. Compared are

    link k  one force at one point of its surface, anywhere on it, pressing inwards: the component
            along the normal positive, those across it TANGENT times as large
    E       a force at E, with a moment of one of LEVERS times its size: none, or that of a tool

each with the likelihood that is left when force, point and size are integrated out,

    p(tau | place) = mean over points and sizes of N(tau; 0, F^2 B^T B + Sigma) 2 Phi(f_n / sd(f_n))

with B = S^(1/2) J_P, S the shares of normal and tangent, and F one of SIZES. Each point stands for
a patch of the surface: the changes of a push anywhere on it are two more rows of B. That a place
could cause many other torques counts against it, so that the narrowest one that explains the
torques wins, with no constant of its own: a joint beyond the touched link that stays unloaded says
so as loudly as its sd allows. All samples of a contact share one point: their log likelihoods count
as one sample, for the errors of an arm last as long as its contacts. Where the mean of a joint's
torque is above LOADED of its sd, the links before that joint are out.

**Shape.** Nothing but the Jacobian is needed. The arm is a chain of its axes, each between the
points nearest to the axis before and to the one after (its feet; of parallel axes, the foot of the
point before), and of the lines from one axis to the next. Such a line is of the link between both
axes. The housing of a joint lies along its axis, REACH beyond both feet; where on it the one link
ends and the next begins the Jacobian does not say: anywhere between the feet is as likely, and
where these coincide every point is of either link. So link 6 of an arm may be touched around axis
7, too, where joint 7 says nothing. The surface lies at RADII, alternating, around axis or line,
with a cap at both ends of a housing; a point of it counts by its area and by how likely it is of
the link. A push that turns about the line with its point leaves the line's own torque alone.

**Error.** Sigma = D R D, with R the correlation of the joints' errors and D from the sd of each,
SCALE of its own torque (a gain that is off) and CROSS of the largest (an axis that is not where the
model has it, friction of its bearing).

Every J is (6, n), rows [angular; linear] at E in axes of W; all joints revolute.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr, logsumexp

from wrenchsight.models.estimation.wrench import PRIOR_LEVER
from wrenchsight.models.numerics.arrays import Array, Flags

RADII = (0.06, 0.1)  # m
REACH = 0.08  # m
TANGENT = 0.3
LEVERS = (0.0, PRIOR_LEVER)  # m
SIZES = (3.0, 10.0, 30.0, 100.0)  # N
SCALE, CROSS = 0.03, 0.01
LOADED = 3.0  # times its sd: beyond, a joint's torque is no error of a model of friction
AT_WORK = 0.5  # odds of E, before a torque is read, of an arm that works with its tool
DOUBT = 0.1  # largest odds of a link that leave a reading at E valid
NAMED = 0.1  # least odds of a link that is named
MOST_NAMED = 3
_ALONG, _AROUND = 5, 8
_PARALLEL = 1e-3  # squared sine of the angle between axes
_POINT = 1e-6  # m; what is shorter has no direction
_SD = 1.0 / np.sqrt(12.0)  # of what is as likely anywhere on a length of 1


class PlaceOdds(NamedTuple):
    """Odds of a contact's place; they add up to 1.

    Attributes:
        links: (n,) of a force on link 1 to n.
        at_E: of a force at E.
    """

    links: Array
    at_E: float

    @classmethod
    def of(cls, evidence: Array, at_E: float | None = None) -> "PlaceOdds":
        """From log likelihoods (n + 1,) of link 1 to n and of E, that `place_evidence` finds.

        Args:
            at_E: odds of E before a torque is read; the links share the rest. None: E and every
                link are as likely.
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
    def bodies(self) -> Array:
        """(n,) odds of each link as a body: E counts for the last one, which carries it."""
        bodies = self.links.copy()
        bodies[-1] += self.at_E
        return bodies

    def named(self) -> list[int]:
        """The links, 1 to n, that explain the contact, likeliest first: three at most."""
        bodies = self.bodies
        order = np.argsort(-bodies, kind="stable")[:MOST_NAMED]
        return [int(k) + 1 for k in order if bodies[k] >= NAMED]


def place_evidence(
    J: ArrayLike,
    tau_ext: ArrayLike,
    sd: ArrayLike,
    correlation: ArrayLike | None = None,
    loaded: float = LOADED,
) -> Array:
    """Log likelihoods (n + 1,) of link 1 to n and of E for one contact, up to a common constant.

    Args:
        J: (K, 6, n) of K samples of it.
        tau_ext: (K, n) N m, of the contact alone: less what is read without it.
        sd: (K, n) N m of its error.
        correlation: (n, n) of the errors of the joints; None: they are independent.
        loaded: times its sd, beyond which the mean of a joint's torque is no error.

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
    D = np.sqrt(sd**2 + (SCALE * tau) ** 2 + (CROSS * largest) ** 2)
    carries = np.flatnonzero(np.abs(np.mean(tau / D, axis=0)) > loaded)
    first_link = int(carries[-1]) if len(carries) else 0
    places: list[list[Array]] = [[] for _ in range(n + 1)]
    weights = [np.empty(0)] * n
    for J_k, tau_k, D_k in zip(J, tau, D, strict=True):
        white = np.linalg.inv(np.linalg.cholesky(D_k[:, None] * R * D_k))
        y = white @ tau_k
        surfaces = _surfaces(J_k)
        for k in range(first_link, n):
            B = _on_link(J_k, k, surfaces[k]) @ white.T
            places[k].append(_log_likelihood(B, y, inwards=True))
            weights[k] = surfaces[k].weight  # the posture changes little during a contact
        B = np.stack([np.concatenate([J_k[3:], lever * J_k[:3]]) for lever in LEVERS]) @ white.T
        places[n].append(_log_likelihood(B, y, inwards=False))
    weights.append(np.full(len(LEVERS), 1.0 / len(LEVERS)))
    evidence = np.full(n + 1, -np.inf)
    for k in range(first_link, n + 1):
        mean = np.mean(places[k], axis=0)  # (points, sizes)
        evidence[k] = logsumexp(mean, b=weights[k][:, None] / len(SIZES))
    return evidence


class _Surface(NamedTuple):
    """M points of a link's surface, m from E and in axes of W.

    Attributes:
        point, normal: (M, 3), the normal outwards.
        weight: (M,) how much of the link's surface each stands for; they add up to 1.
        along: (M, 3) moment about the point of a unit force inwards, one sd along the surface.
        around: (M, 2, 3) moment and change of the force, one sd around it.
    """

    point: Array
    normal: Array
    weight: Array
    along: Array
    around: Array

    @classmethod
    def of(cls, parts: "list[_Surface]") -> "_Surface":
        """All of them together, the weights added up to 1."""
        joined = cls(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
        return joined._replace(weight=joined.weight / joined.weight.sum())

    def shared(self, share: Array) -> "_Surface":
        """With weights in proportion to (M,)."""
        return self._replace(weight=self.weight * share)


def axis_feet(J: Array) -> tuple[Array, Array]:
    """The feet of axis 1 to n: its points nearest to the previous and to the next axis.

    The last foot of the last axis is its point nearest to E. J does not determine where a prismatic
    joint lies: it takes the previous point, or E.

    Returns:
        (n, 3) first feet and (n, 3) last feet, m from E in axes of W.
    """
    slides = _slides(J)
    axis = np.where(slides, J[3:], J[:3]).T
    foot = np.cross(J[:3].T, J[3:].T)
    n = len(axis)

    def on_axis(k: int, point: Array) -> Array:
        if slides[k]:
            return point
        return np.asarray(foot[k] + axis[k] * float(axis[k] @ (point - foot[k])))

    nearest = [
        None if slides[k] or slides[k + 1] else _nearest(axis[k : k + 2], foot[k : k + 2])
        for k in range(n - 1)
    ]
    first_foot, last_foot = np.zeros((n, 3)), np.zeros((n, 3))
    for k in range(n):
        nearest_before = nearest[k - 1] if k else None
        nearest_after = nearest[k] if k < n - 1 else None
        if nearest_before is not None:
            first_foot[k] = nearest_before[1]
        elif k:
            first_foot[k] = on_axis(k, last_foot[k - 1])
        else:
            first_foot[k] = on_axis(k, np.zeros(3)) if nearest_after is None else nearest_after[0]
        if k == n - 1:
            last_foot[k] = on_axis(k, np.zeros(3))
        else:
            last_foot[k] = first_foot[k] if nearest_after is None else nearest_after[0]
    return first_foot, last_foot


def _nearest(axis: Array, point: Array) -> tuple[Array, Array] | None:
    """The points of two lines (2, 3) that are nearest to the other one; None: they are parallel."""
    (a, b), (p, r) = axis, point
    cosine = float(a @ b)
    sine2 = 1.0 - cosine * cosine
    if sine2 < _PARALLEL:
        return None
    apart = p - r
    s = (cosine * float(b @ apart) - float(a @ apart)) / sine2
    u = (float(b @ apart) - cosine * float(a @ apart)) / sine2
    return p + s * a, r + u * b


def _slides(J: Array) -> Flags:
    """(n,) which joints are prismatic, of J (6, n)."""
    return np.asarray(np.linalg.norm(J[:3], axis=0) < 0.5)


def _surfaces(J: Array) -> list[_Surface]:
    """Of link 1 to n."""
    axis = np.where(_slides(J), J[3:], J[:3]).T
    first_foot, last_foot = axis_feet(J)
    n = len(axis)
    parts: list[list[_Surface]] = [[] for _ in range(n)]
    for k in range(n):
        between = last_foot[k] - first_foot[k]
        length = float(np.linalg.norm(between))
        u = between / length if length > _POINT else axis[k]
        side = axis[k - 1] if k else np.eye(3)[int(np.argmin(np.abs(u)))]
        end = last_foot[k] + (0.0 if k == n - 1 and length > _POINT else REACH) * u
        housing, at = _housing(first_foot[k] - REACH * u, end, side)
        whole = float(np.linalg.norm(end - first_foot[k])) + REACH
        share = 0.5 + length / whole * at  # of link k; the one before has the rest
        parts[k].append(housing.shared(share))
        if k:
            parts[k - 1].append(housing.shared(1.0 - share))
        to = first_foot[k + 1] if k < n - 1 else np.zeros(3)
        if np.linalg.norm(to - last_foot[k]) > _POINT:
            parts[k].append(_tube(last_foot[k], to, axis[k])[0])
    return [_Surface.of(part) for part in parts]


def _tube(begin: Array, end: Array, side: Array) -> tuple[_Surface, Array]:
    """Around the line between two points, and (M,) where along it each point is, -1/2 to 1/2."""
    length = float(np.linalg.norm(end - begin))
    u, ring = _ring(begin, end, side)
    at = (np.arange(_ALONG) + 0.5) / _ALONG - 0.5
    radius = np.array([np.resize(np.roll(RADII, -(i % 2)), _AROUND) for i in range(_ALONG)])
    middle = 0.5 * (begin + end) + at[:, None] * (end - begin)
    point = (middle[:, None] + radius[..., None] * ring).reshape(-1, 3)
    normal = np.tile(ring, (_ALONG, 1))
    size = len(point)
    step = 2.0 * np.pi / _AROUND * _SD  # rad
    tangent = np.cross(u, normal)
    moment = step * radius.reshape(-1, 1) * np.cross(tangent, -normal)
    surface = _Surface(
        point,
        normal,
        np.full(size, 2.0 * np.pi * float(np.mean(RADII)) * length / size),
        length / _ALONG * _SD * np.cross(u, -normal),
        np.stack([moment, -step * tangent], axis=1),
    )
    return surface, np.repeat(at, _AROUND)


def _housing(begin: Array, end: Array, side: Array) -> tuple[_Surface, Array]:
    """A tube and its two caps, each a ring that slants and a face across; as `_tube`."""
    tube, at = _tube(begin, end, side)
    u, ring = _ring(begin, end, side)
    radius = float(np.mean(RADII))
    parts, place = [tube], [at]
    for middle, sign in ((begin, -1.0), (end, 1.0)):
        slant = np.sqrt(0.5) * (ring[::2] + sign * u)
        normal = np.vstack([slant, sign * u])
        point = middle + radius * np.vstack([slant, 0.5 * sign * u])
        count = len(slant)
        weight = 0.5 * np.pi * radius**2 * np.append(np.full(count, 1.0 / count), 1.0)
        reach = radius * _SD * np.append(np.ones(count), 2.0)[:, None]
        tangent, other = _across(normal)
        moment = np.stack([reach * other, np.zeros_like(other)], axis=1)
        parts.append(_Surface(point, normal, weight, reach * tangent, moment))
        place.append(np.full(count + 1, 0.5 * sign))
    joined = _Surface(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    return joined, np.concatenate(place)


def _ring(begin: Array, end: Array, side: Array) -> tuple[Array, Array]:
    """The unit vector along a line, and (_AROUND, 3) those around it, from `side` on."""
    u = (end - begin) / float(np.linalg.norm(end - begin))
    if np.linalg.norm(np.cross(u, side)) < 0.1:
        side = np.eye(3)[int(np.argmin(np.abs(u)))]
    e1 = np.cross(u, side) / np.linalg.norm(np.cross(u, side))
    turn = 2.0 * np.pi * np.arange(_AROUND)[:, None] / _AROUND
    return u, np.cos(turn) * e1 + np.sin(turn) * np.cross(u, e1)


def _across(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors (M, 3) across each of (M, 3)."""
    tangent = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)])
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    return tangent, np.cross(normal, tangent)


def _on_link(J: Array, k: int, surface: _Surface) -> Array:
    """B (M, 5, n) of link k (0-based): the force inwards and along two tangents, and the changes of
    the first anywhere on the point's patch.
    """
    tangent, other = _across(surface.normal)
    none = np.zeros_like(tangent)
    force = [-surface.normal, TANGENT * tangent, TANGENT * other, none, surface.around[:, 1]]
    moment = [none, none, none, surface.along, surface.around[:, 0]]
    at_point = J[3:].T + np.cross(J[:3].T, surface.point[:, None])  # (M, n, 3)
    B = np.stack(force, axis=1) @ at_point.swapaxes(1, 2) + np.stack(moment, axis=1) @ J[:3]
    B[:, :, k + 1 :] = 0.0
    return np.asarray(B)


def _log_likelihood(B: Array, y: Array, inwards: bool) -> Array:
    """(m, sizes) log N(y; 0, 1 + F^2 B^T B), up to what all places share, for B (m, d, n).

    Args:
        inwards: whether the first row's component is positive.
    """
    F2 = np.square(SIZES)
    values, vectors = np.linalg.eigh(B @ B.swapaxes(1, 2))
    projected = ((B @ y)[:, None] @ vectors)[:, 0]  # (m, d)
    share = 1.0 / (1.0 + F2[:, None] * np.maximum(values, 0.0)[:, None])  # (m, sizes, d)
    log = 0.5 * (F2[:, None] * share * projected[:, None] ** 2 + np.log(share)).sum(axis=2)
    if inwards:
        normal_share = vectors[:, 0]  # (m, d): the normal's row
        mean = (F2[:, None] * share * (normal_share * projected)[:, None]).sum(axis=2)
        variance = (F2[:, None] * share * (normal_share**2)[:, None]).sum(axis=2)
        log = log + np.log(2.0) + log_ndtr(mean / np.sqrt(variance))
    return np.asarray(log)
