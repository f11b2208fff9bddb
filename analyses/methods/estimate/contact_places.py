"""Places of contacts: odds of E and of each link, and the readings that a link voids.

A contact on a link is no wrench at E, however well such a wrench explains the torques. Each contact
of a part of a log is cut into pieces of MAX_PIECE_TIME from its begin. Some of the strongest
samples of each piece give evidence (`models.detection.link_odds`). A piece is judged by its own,
that of all pieces before it and that of the next one: what a log holds later changes no verdict.

- A link before the last wins: the piece's samples are a misfit.
- The links before the last have odds above MAX_LINK_ODDS: the piece's readings are not valid.

Both rules presuppose an arm at work, half of whose contacts are at E. The stated odds presuppose
nothing: E and each link are equally likely beforehand.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.detection.link_odds import (
    AT_WORK,
    LOADED_SDS,
    MAX_LINK_ODDS,
    PlaceOdds,
    place_evidence,
)
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.stretches import stretches

# s before a contact, between which its baseline is read
BASELINE_TIME, CONTACT_GUARD_TIME = 0.3, 0.05
NUM_SAMPLES = 5  # of a contact, evenly spread over those of at least half of its largest size
MAX_PIECE_TIME = 2.0  # s, of a contact's piece: its error shows little about that of the next piece


class ContactTorque(NamedTuple):
    """Torque of contacts, over N samples.

    Attributes:
        t: (N,) s.
        J: (N, 6, n) as the observer's lag makes the torque see it.
        tau: (N, n) N m, of the contact alone: less the reading without it.
        sd: (N, n) N m, of its error.
        correlation: (n, n) of the joints' errors; None: they are independent.
    """

    t: Array
    J: Array
    tau: Array
    sd: Array
    correlation: Array | None = None


class PlacedContacts(NamedTuple):
    """Contacts with their places, over N samples.

    Attributes:
        detection: its misfit and link are those of the places.
        odds: (N, n + 1) of link 1 to n and of E; zero without contact.
        may_be_valid: (N,) whether a reading at E may be valid.
    """

    detection: Detection
    odds: Array
    may_be_valid: Flags


def _pieces(stretch: slice, t: Array) -> list[slice]:
    """A stretch in pieces of MAX_PIECE_TIME from its begin; the last is up to half longer."""
    begin, end = float(t[stretch.start]), float(t[stretch.stop - 1])
    cuts = np.arange(begin + MAX_PIECE_TIME, end - 0.5 * MAX_PIECE_TIME, MAX_PIECE_TIME)
    limits = [stretch.start, *np.searchsorted(t, cuts).tolist(), stretch.stop]
    return [slice(start, stop) for start, stop in pairwise(limits) if stop > start]


def torque_of_contacts(contact: Flags, t: Array, tau_ext: Array) -> Array:
    """Torque (N, n) less its mean right before the contact, in the first MAX_PIECE_TIME s of each;
    N m.

    The errors of a model last longer than a push takes to come. Later they have changed: the torque
    stays as it is, as it does where a contact begins with the first sample.

    Args:
        contact: (N,).
        t: (N,) s.
        tau_ext: (N, n) N m.
    """
    result = tau_ext.copy()
    for stretch in stretches(contact):
        begin = t[stretch.start]
        start, stop = np.searchsorted(t, (begin - BASELINE_TIME, begin - CONTACT_GUARD_TIME))
        baseline = tau_ext[start:stop][~contact[start:stop]]
        baseline = baseline[np.isfinite(baseline).all(axis=1)]
        if len(baseline):
            end = min(int(np.searchsorted(t, begin + MAX_PIECE_TIME)), stretch.stop)
            result[stretch.start : end] -= baseline.mean(axis=0)
    return result


def judge_places(
    detection: Detection, torque: ContactTorque, loaded: float = LOADED_SDS
) -> PlacedContacts:
    """Finds the place of each contact.

    A contact is judged piece by piece, each by the evidence of the pieces up to the next one. That
    evidence is weighed twice: the odds that are reported count E and every link as equally likely
    before; misfit, link and whether a reading at E may be valid count E as likely as AT_WORK.

    Args:
        detection: of N samples.
        torque: of the contacts; samples that are not finite give no evidence.
        loaded: as `place_evidence`.

    Returns:
        Outside of contacts no misfit, link 0, odds of zero, and readings that may be valid.
    """
    N, n = torque.tau.shape
    odds = np.zeros((N, n + 1))
    misfit = np.zeros(N, bool)
    link = np.zeros(N, np.int8)
    may_be_valid = np.ones(N, bool)
    is_finite = np.asarray(
        np.isfinite(torque.tau + torque.sd).all(axis=1) & np.isfinite(torque.J).all(axis=(1, 2))
    )
    size: NDArray[np.float64] = np.zeros(N)  # of the torque, in sds of its error
    size[is_finite] = np.linalg.norm(torque.tau[is_finite] / torque.sd[is_finite], axis=1)
    for stretch in stretches(detection.contact):
        pieces = _pieces(stretch, torque.t)
        # (pieces + 1, n + 1) log likelihoods of links and E. The last piece has no next one: a row
        # of zeros stands for it.
        evidence = np.zeros((len(pieces) + 1, n + 1))
        for k, piece in enumerate(pieces):
            rows = _strong_rows(piece, is_finite, size)
            if len(rows):
                evidence[k] = place_evidence(
                    torque.J[rows], torque.tau[rows], torque.sd[rows], torque.correlation, loaded
                )
        up_to_next = np.cumsum(evidence, axis=0)[1:]  # row k: of the pieces 0 to k + 1
        for piece, piece_evidence in zip(pieces, up_to_next, strict=True):
            stated = PlaceOdds.of(piece_evidence)
            at_work = PlaceOdds.of(piece_evidence, AT_WORK)
            odds[piece] = np.append(stated.links, stated.at_E)
            misfit[piece] = at_work.on_link
            link[piece] = at_work.touched_link
            # The last link carries E: a contact on it counts as one at E.
            may_be_valid[piece] = at_work.links[:-1].sum() <= MAX_LINK_ODDS
    return PlacedContacts(detection._replace(misfit=misfit, link=link), odds, may_be_valid)


def _strong_rows(piece: slice, is_finite: Flags, size: Array) -> NDArray[np.int64]:
    """At most NUM_SAMPLES indices of a piece, evenly spread over those of half its largest size."""
    indices = np.arange(piece.start, piece.stop)[is_finite[piece]]
    if not len(indices):
        return indices
    strong = indices[size[indices] >= 0.5 * size[indices].max()]
    chosen = np.linspace(0, len(strong) - 1, min(NUM_SAMPLES, len(strong))).astype(int)
    return np.asarray(strong[chosen])
