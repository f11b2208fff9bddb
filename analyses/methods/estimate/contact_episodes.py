"""Contacts of a log, gathered chunk by chunk: begin, end, force and place of each.

A contact that begins less than MIN_EXCURSION_GAP s after the last one ended belongs to that one.
The tail of the exceedances is counted in the same way
(`wrenchsight.models.signals.exceedance_tail`).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.detection.link_odds import PlaceOdds
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.stretches import stretches
from wrenchsight.models.signals.exceedance_tail import MIN_EXCURSION_GAP

MAX_LISTED_CONTACTS = 1000  # contacts in metrics.json; further ones are only counted
MAX_PRINTED_CONTACTS = 8  # contacts that the command prints
FAR_CLOCK = 1e6  # s; with a clock that shows more, times are stated since the first sample


@dataclass
class Contact:
    """One contact.

    Attributes:
        begin, end: s, first and last sample of it.
        statistic: largest contact statistic.
        force: N, largest valid force; None where no sample is valid.
        misfit: share of its samples that a force at E does not explain, or that a link explains
            better.
        link: that explains most of those, 1 to n; 0: the joints do not determine it.
        place: odds of its place, where they were judged.
    """

    begin: float
    end: float
    statistic: float
    force: float | None
    misfit: float
    link: int
    place: PlaceOdds | None = None

    def sentence(self, origin: float) -> str:
        """Time, duration, force and place in a sentence; time since `origin` s."""
        duration = f"{self.end - self.begin:.2f} s"
        if duration == "0.00 s":  # from its first sample to its last: it may be a single one
            duration = "less than 0.01 s"
        time = f"contact at t = {self.begin - origin:.2f} s for {duration}"
        force = "no valid force" if self.force is None else f"up to {self.force:.3g} N"
        place = ""
        if self.place is not None:
            place = f", {self._place_text(self.place)}"
        elif self.misfit > 0.0:
            place = f", not at E: link {self.link}" if self.link else ", not at E"
        return f"{time}, {force}{place}"

    @property
    def not_at_E(self) -> bool:
        """Whether a link before the last explains most of the contact better than E does."""
        return self.misfit > 0.5

    def _place_text(self, place: PlaceOdds) -> str:
        """Every likely place, likeliest first; E and the link that carries it are one."""
        bodies, last_link = place.bodies, len(place.links)
        texts = []
        for link in place.named():
            carries_E = link == last_link and not self.not_at_E
            preposition = "at E or on link" if carries_E else "on link"
            texts.append(f"{preposition} {link} ({100.0 * bodies[link - 1]:.0f} %)")
        return ("not at E: " if self.not_at_E else "") + ", or ".join(texts)

    def metrics(self) -> dict[str, Any]:
        """The contact as metrics.json lists it."""
        result: dict[str, Any] = {
            "begin_s": self.begin,
            "end_s": self.end,
            "largest_statistic": self.statistic,
            "largest_force_n": self.force,
            "misfit_pct": 100.0 * self.misfit,
            "link": self.link or None,
        }
        if self.place is not None:
            bodies = self.place.bodies
            result["at_e_pct"] = 100.0 * self.place.at_E
            result["not_at_e"] = self.not_at_E
            result["links"] = [
                {"link": link, "odds_pct": 100.0 * bodies[link - 1]} for link in self.place.named()
            ]
        return result


def stated_origin(log_begin: float) -> float:
    """s on the log's clock, since which times are stated: 0, but of a clock that began long ago."""
    return log_begin if abs(log_begin) >= FAR_CLOCK else 0.0


class _OpenContact:
    """A contact that has not ended yet.

    Args:
        begin: s.
        num_joints: n.
    """

    def __init__(self, begin: float, num_joints: int) -> None:
        self.contact = Contact(begin, begin, 0.0, None, 0.0, 0)
        self._num_samples = 0
        self._num_misfits = 0
        self._link_counts = np.zeros(num_joints + 1)  # samples that 0: no link, 1 to n explain
        self._odds = np.zeros(num_joints + 1)  # summed over samples: link 1 to n, E

    def add(
        self,
        t: Array,
        detection: Detection,
        force_size: Array,
        valid: Flags,
        odds: Array | None,
    ) -> None:
        """Takes samples of the contact; `force_size` (N,) N, the rest as `ContactEpisodes.add`."""
        contact = self.contact
        contact.end = float(t[-1])
        contact.statistic = max(contact.statistic, float(detection.statistic.max()))
        if valid.any():
            contact.force = max(contact.force or 0.0, float(force_size[valid].max()))
        self._num_samples += len(t)
        self._num_misfits += int(detection.misfit.sum())
        if odds is not None:
            self._odds += odds.sum(axis=0)
        links = detection.link[detection.misfit]
        self._link_counts += np.bincount(links, minlength=len(self._link_counts))

    def finish(self) -> Contact:
        """The contact, with its misfit, link and place."""
        contact = self.contact
        contact.misfit = self._num_misfits / self._num_samples
        if self._link_counts[1:].sum() > self._link_counts[0]:
            contact.link = 1 + int(np.argmax(self._link_counts[1:]))
        if self._odds.any():
            odds = self._odds / self._odds.sum()
            contact.place = PlaceOdds(odds[:-1], float(odds[-1]))
        return contact


class ContactEpisodes:
    """Gathers contacts chunk by chunk.

    Args:
        num_joints: n.
        gap: s, between two contacts that count as one.

    Attributes:
        contacts: the first MAX_LISTED_CONTACTS ones that have ended.
        num_contacts: number of contacts of all that have ended.
    """

    def __init__(self, num_joints: int, gap: float = MIN_EXCURSION_GAP) -> None:
        self._gap = gap
        self._num_joints = num_joints
        self.contacts: list[Contact] = []
        self.num_contacts = 0
        self._num_samples = 0
        # Samples in which a flag of `Detection` is set, by its name.
        self._counts = dict.fromkeys(("contact", "misfit", "rest", "out_of_range"), 0)
        self._log_begin: float | None = None
        self._open: _OpenContact | None = None

    def add(
        self,
        t: Array,
        detection: Detection,
        force: Array,
        valid: Flags,
        odds: Array | None = None,
    ) -> None:
        """Takes the next N samples.

        A contact that has begun stays open, for the chunks to come as well, until one begins more
        than the gap after its end, or `finish` is called.

        Args:
            t: (N,) s.
            detection: of these samples.
            force: (N, 3) N.
            valid: (N,) whether the force may be used.
            odds: (N, n + 1) of link 1 to n and of E, 0 without contact; None: they were not judged.
        """
        if not len(t):
            return
        if self._log_begin is None:
            self._log_begin = float(t[0])
        self._num_samples += len(t)
        for flag in self._counts:  # each is an attribute of `Detection`
            self._counts[flag] += int(getattr(detection, flag).sum())
        force_size = np.linalg.norm(force, axis=1)
        for rows in stretches(detection.contact):
            begin = float(t[rows.start])
            if self._open is not None and begin - self._open.contact.end > self._gap:
                self.finish()
            if self._open is None:
                self._open = _OpenContact(begin, self._num_joints)
            self._open.add(
                t[rows],
                detection.rows(rows),
                force_size[rows],
                valid[rows],
                None if odds is None else odds[rows],
            )

    def finish(self) -> None:
        """Ends the last contact; no sample of it follows."""
        if self._open is None:
            return
        self.num_contacts += 1
        if len(self.contacts) < MAX_LISTED_CONTACTS:
            self.contacts.append(self._open.finish())
        self._open = None

    @property
    def rested(self) -> bool:
        """Whether the arm rested at some sample."""
        return self._counts["rest"] > 0

    def metrics(self, false_alarms_per_hour: float | None = None) -> dict[str, Any]:
        """All figures, as metrics.json holds them under `contact`.

        Args:
            false_alarms_per_hour: that is stated; None: none is.
        """
        share = 100.0 / max(self._num_samples, 1)
        return {
            "false_alarms_per_hour": false_alarms_per_hour,
            "count": self.num_contacts,
            **{f"{name}_pct": share * count for name, count in self._counts.items()},
            "contacts": [contact.metrics() for contact in self.contacts],
        }

    def lines(self) -> list[str]:
        """Sentences for the user: the first MAX_PRINTED_CONTACTS contacts, and how many follow."""
        if not self.contacts:
            return ["no contact found"]
        origin = stated_origin(self._log_begin or 0.0)
        lines = [contact.sentence(origin) for contact in self.contacts[:MAX_PRINTED_CONTACTS]]
        num_further = self.num_contacts - len(lines)
        if num_further > 0:
            lines.append(f"{num_further} further contacts: see metrics.json")
        return lines
