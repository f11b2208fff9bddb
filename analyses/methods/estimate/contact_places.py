"""Where the contacts of a log are: at E or on a link, with odds, and which readings that voids.

A contact on a link is no wrench at E, however well one explains the torques. So each contact of a
part of a log is judged as a whole, by some of the strongest samples of each of its pieces
(`models.detection.link_odds`), whose evidence is added up;
where a link before the last wins, its samples are a misfit; where one has odds above DOUBT, their
readings are not valid. Both presuppose an arm at work, of whose contacts every other one is at E:
such readings are meant to be of E. The odds that are stated presuppose nothing: before a torque is
read E and each link are as likely.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.detection.link_odds import (
    AT_WORK,
    DOUBT,
    LOADED,
    PlaceOdds,
    place_evidence,
)
from wrenchsight.models.numerics.arrays import Array, Flags

BEFORE, GUARD = 0.3, 0.05  # s before a contact, between which it is read what it starts from
SAMPLES = 5  # of a contact, evenly spread over those of at least half of its largest size
LONGEST = 2.0  # s, of a contact's piece: the error of one says little about that of the next
MOST_PIECES = 20


def stretches(flag: Flags) -> list[slice]:
    """The stretches of N samples in which a flag is set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flag, [False]]).astype(np.int8)))
    return [slice(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]


def _pieces(whole: slice, t: Array) -> list[slice]:
    """A stretch, cut into at most MOST_PIECES of no more than LONGEST s where that is enough."""
    first, last = float(t[whole.start]), float(t[whole.stop - 1])
    count = min(max(1, int(np.ceil((last - first) / LONGEST))), MOST_PIECES)
    cuts = np.searchsorted(t, np.linspace(first, last, count + 1)[1:-1])
    limits = [whole.start, *(int(k) for k in cuts), whole.stop]
    return [slice(a, b) for a, b in pairwise(limits) if b > a]


def of_contacts(contact: Flags, t: Array, tau_ext: Array) -> Array:
    """(N, n) N m, the torque less that right before its contact, for the first LONGEST s of it.

    The errors of a model last longer than a push takes to come. Later they have changed, and where
    a contact begins with the samples there is nothing before it: there the torque is as it stands.

    Args:
        contact: (N,).
        t: (N,) s.
        tau_ext: (N, n) N m.
    """
    result = tau_ext.copy()
    for whole in stretches(contact):
        begin = t[whole.start]
        first, last = np.searchsorted(t, (begin - BEFORE, begin - GUARD))
        before = tau_ext[first:last][~contact[first:last]]
        before = before[np.isfinite(before).all(axis=1)]
        if len(before):
            until = min(int(np.searchsorted(t, begin + LONGEST)), whole.stop)
            result[whole.start : until] -= before.mean(axis=0)
    return result


def judge_places(
    found: Detection,
    t: Array,
    J: Array,
    tau: Array,
    sd: Array,
    correlation: Array | None = None,
    loaded: float = LOADED,
) -> tuple[Detection, Array, Flags]:
    """Says of each contact where it is.

    Args:
        found: of N samples; its misfit and link are replaced.
        t: (N,) s.
        J: (N, 6, n) as the torque saw it.
        tau: (N, n) N m, of the contact alone: less what would be read without it.
        sd: (N, n) N m of its error.
        correlation: (n, n) of the errors of the joints.
        loaded: as `place_evidence`.

    Returns:
        The detection, the odds (N, n + 1) of link 1 to n and E (zero without contact), and (N,)
        whether a reading at E may be valid: of an arm at work the links before the last have odds
        of at most DOUBT.
    """
    N, n = tau.shape
    odds = np.zeros((N, n + 1))
    misfit, link, trusted = np.zeros(N, bool), np.zeros(N, np.int8), np.ones(N, bool)
    known = np.asarray(np.isfinite(tau + sd).all(axis=1) & np.isfinite(J).all(axis=(1, 2)))
    size: NDArray[np.float64] = np.zeros(N)
    size[known] = np.linalg.norm(tau[known] / sd[known], axis=1)
    for whole in stretches(found.contact):
        evidence = np.zeros(n + 1)
        for piece in _pieces(whole, t):
            inside = np.arange(piece.start, piece.stop)[known[piece]]
            if not len(inside):
                continue
            strong = inside[size[inside] >= 0.5 * size[inside].max()]
            chosen = strong[np.linspace(0, len(strong) - 1, min(SAMPLES, len(strong))).astype(int)]
            evidence += place_evidence(J[chosen], tau[chosen], sd[chosen], correlation, loaded)
        stated, at_work = PlaceOdds.of(evidence), PlaceOdds.of(evidence, AT_WORK)
        odds[whole] = np.append(stated.links, stated.at_E)
        misfit[whole] = at_work.on_link
        link[whole] = at_work.named()[0] if at_work.on_link else 0
        trusted[whole] = at_work.links[:-1].sum() <= DOUBT
    return found._replace(misfit=misfit, link=link), odds, trusted
