"""Which link was touched, or was it the tool: odds of a contact's place, from joint torques alone.

A force f at a point P of link k loads joints 1 to k by J_P^T f, and no joint beyond. Compared are

    link k  one force at one point of its surface, anywhere on it, pressing inwards: the component
            along the normal positive, those across it TANGENT times as large
    E       a force at E, with a moment of one of LEVERS times its size: none, or that of a tool

each with the likelihood that is left when force, point and size are integrated out,

    p(tau | place) = mean over points and sizes of N(tau; 0, F^2 B^T B + Sigma) 2 Phi(f_n / sd(f_n))

with B = S^(1/2) J_P, S the shares of normal and tangent, and F one of SIZES. Each point stands for
a patch of the surface: the moments of a force anywhere on it are two more rows of B. That a place
could cause many other torques counts against it, so that the narrowest one that explains the
torques wins, with no constant of its own: a joint beyond the touched link that stays unloaded says
so as loudly as its sd allows. All samples of a contact share one point: their log likelihoods count
as one sample, for the errors of an arm last as long as its contacts. Where the mean of a joint's
torque is above LOADED of its sd, the links before that joint are out.

**Shape.** Nothing but the Jacobian is needed. Link k reaches from the point between its own axis
and the one before to the point between its own axis and the next (the middle of their common
perpendicular; of parallel axes, the foot of the point before), the last one to E. Around that
line its surface lies at RADII, alternating, with a cap at each end.

**Error.** Sigma = D R D, with R the correlation of the joints' errors and D from the sd of each,
SCALE of its own torque (a gain that is off) and CROSS of the largest (an axis that is not where the
model has it, friction of its bearing).

Every J is (6, n), rows [angular; linear] at E in axes of W; all joints revolute.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr, logsumexp

from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.estimation.wrench import PRIOR_LEVER

RADII = (0.06, 0.1)  # m
TANGENT = 0.4
LEVERS = (0.0, PRIOR_LEVER)  # m
SIZES = (3.0, 10.0, 30.0, 100.0)  # N
SCALE, CROSS = 0.03, 0.01
LOADED = 3.0  # times its sd: beyond, a joint's torque is no error of a model of friction
E_BEFORE = 0.5  # odds of E before a torque was read; the links share the rest
DOUBT = 0.1  # largest odds of a link that leave a reading at E valid
NAMED = 0.1  # least odds of a link that is named
MOST_NAMED = 3
_ALONG, _AROUND = 5, 8
_PARALLEL = 1e-3  # squared sine of the angle between axes


class PlaceOdds(NamedTuple):
    """Odds of a contact's place; they add up to 1.

    Attributes:
        links: (n,) of a force on link 1 to n.
        at_E: of a force at E.
    """

    links: Array
    at_E: float

    @classmethod
    def of(cls, evidence: Array) -> "PlaceOdds":
        """From log likelihoods (n + 1,) of link 1 to n and of E, that `place_evidence` finds."""
        n = len(evidence) - 1
        before = np.append(np.full(n, (1.0 - E_BEFORE) / n), E_BEFORE)
        log = np.asarray(evidence) + np.log(before)
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
    places: list[list[Array]] = [[] for _ in range(n + 1)]
    units: list[Array] = []
    for J_k, tau_k, sd_k in zip(J, tau, sd, strict=True):
        largest = float(np.abs(tau_k).max())
        D = np.sqrt(sd_k**2 + (SCALE * tau_k) ** 2 + (CROSS * largest) ** 2)
        white = np.linalg.inv(np.linalg.cholesky(D[:, None] * R * D))
        y = white @ tau_k
        units.append(tau_k / D)
        for k, surface in enumerate(_surfaces(J_k)):
            B = _on_link(J_k, k, *surface) @ white.T
            places[k].append(_log_likelihood(B, y, inwards=True))
        B = np.stack([np.concatenate([J_k[3:], lever * J_k[:3]]) for lever in LEVERS]) @ white.T
        places[n].append(_log_likelihood(B, y, inwards=False))
    means = [np.mean(samples, axis=0) for samples in places]
    evidence = np.array([logsumexp(own) - np.log(own.size) for own in means])
    carries = np.flatnonzero(np.abs(np.mean(units, axis=0)) > loaded)
    if len(carries):
        evidence[: carries[-1]] = -np.inf
    return evidence


def link_ends(J: Array) -> Array:
    """(n, 3) m from E in axes of W: the far end of link 1 to n; J (6, n).

    Where a prismatic joint lies J does not tell: its link ends where the one before does, or on the
    next axis.
    """
    axis, foot = J[:3].T, np.cross(J[:3].T, J[3:].T)
    slides = _slides(J)
    ends: list[Array] = []
    for k in range(J.shape[1] - 1):
        a, b, p, r = axis[k], axis[k + 1], foot[k], foot[k + 1]
        cosine = float(a @ b)
        sine2 = 1.0 - cosine * cosine
        if slides[k] or slides[k + 1] or sine2 < _PARALLEL:
            before = ends[-1] if ends else r if slides[k] else p
            ends.append(before if slides[k + 1] else r + b * float(b @ (before - r)))
            continue
        apart = p - r
        s = (cosine * float(b @ apart) - float(a @ apart)) / sine2
        u = (float(b @ apart) - cosine * float(a @ apart)) / sine2
        ends.append(0.5 * (p + s * a + r + u * b))
    ends.append(np.zeros(3))
    return np.array(ends)


def _slides(J: Array) -> Flags:
    """(n,) which joints are prismatic, of J (6, n)."""
    return np.asarray(np.linalg.norm(J[:3], axis=0) < 0.5)


def _surfaces(J: Array) -> list[tuple[Array, Array, float]]:
    """Per link its points (m, 3), m from E, their outward normals, in axes of W, and its length."""
    ends, axis = link_ends(J), np.where(_slides(J), J[3:], J[:3]).T
    n = len(ends)
    turn = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    result = []
    for k in range(n):
        begin, end = ends[max(k - 1, 0)], ends[k]
        along = end - begin
        length = float(np.linalg.norm(along))
        u = along / length if length > 1e-6 else axis[k]
        # Fixed to the link: its own axis or the next one, whichever is further from the line.
        sides = [axis[k], axis[min(k + 1, n - 1)], np.eye(3)[int(np.argmin(np.abs(u)))]]
        side = max(sides[:2], key=lambda a: float(np.linalg.norm(np.cross(u, a))))
        if np.linalg.norm(np.cross(u, side)) < 0.1:
            side = sides[2]
        e1 = np.cross(u, side) / np.linalg.norm(np.cross(u, side))
        ring = np.cos(turn)[:, None] * e1 + np.sin(turn)[:, None] * np.cross(u, e1)
        points, normals = [], []
        for i in range(_ALONG):
            radius = np.resize(RADII[i % 2 :] + RADII[: i % 2], _AROUND)[:, None]
            points.append(begin + (i + 0.5) / _ALONG * along + radius * ring)
            normals.append(ring)
        for place, sign in ((begin, -1.0), (end, 1.0)):
            cap = np.sqrt(0.5) * (ring[::2] + sign * u)
            points.append(place + float(np.mean(RADII)) * cap)
            normals.append(cap)
        result.append((np.concatenate(points), np.concatenate(normals), length))
    return result


def _on_link(J: Array, k: int, point: Array, normal: Array, along: float) -> Array:
    """B (m, 5, n) of link k (0-based): the force inwards and along two tangents, and the moments
    about these of the force anywhere on the point's patch.
    """
    tangent = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)])
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    other = np.cross(normal, tangent)
    frame = np.stack([-normal, TANGENT * tangent, TANGENT * other], axis=1)
    patch = max(along / _ALONG, 2.0 * np.pi * float(np.mean(RADII)) / _AROUND) / np.sqrt(12.0)
    turned = patch * np.stack([tangent, other], axis=1)
    at_point = J[3:].T + np.cross(J[:3].T, point[:, None])  # (m, n, 3)
    B = np.concatenate([frame @ at_point.swapaxes(1, 2), turned @ J[:3]], axis=1)
    B[:, :, k + 1 :] = 0.0
    return np.asarray(B)


def _log_likelihood(B: Array, y: Array, inwards: bool) -> Array:
    """(m, sizes) log N(y; 0, 1 + F^2 B^T B), up to what all places share, for B (m, d, n).

    Args:
        inwards: whether the first row's component is positive.
    """
    F2 = np.square(SIZES)
    values, vectors = np.linalg.eigh(B @ B.swapaxes(1, 2))
    seen = ((B @ y)[:, None] @ vectors)[:, 0]  # (m, d)
    share = 1.0 / (1.0 + F2[:, None] * np.maximum(values, 0.0)[:, None])  # (m, sizes, d)
    log = 0.5 * (F2[:, None] * share * seen[:, None] ** 2 + np.log(share)).sum(axis=2)
    if inwards:
        first = vectors[:, 0]  # (m, d): the normal's row
        mean = (F2[:, None] * share * (first * seen)[:, None]).sum(axis=2)
        variance = (F2[:, None] * share * (first**2)[:, None]).sum(axis=2)
        log = log + np.log(2.0) + log_ndtr(mean / np.sqrt(variance))
    return np.asarray(log)
