"""The contacts of a log, one after another, as they stream by.

Contact that begins less than GAP s after the last contact ended belongs to that contact. The tail
of the exceedances is counted in the same way (`wrenchsight.models.signals.exceedance_tail`).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.detection.link_odds import PlaceOdds
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.signals.exceedance_tail import GAP

KEPT = 1000  # contacts that are listed one by one; further ones are only counted
SHOWN = 8  # lines of the command
FAR_CLOCK = 1e6  # s; with a clock that shows more, times are since the first sample


@dataclass
class Contact:
    """One contact.

    Attributes:
        begin, end: s, first and last sample of it.
        statistic: its largest.
        force: N, the largest that is valid; None where none is.
        misfit: share of its samples that a force at E does not explain, or a link does better.
        link: that explains most of those, 1 to n; 0: the joints cannot tell.
        place: its odds, where they were judged.
    """

    begin: float
    end: float
    statistic: float
    force: float | None
    misfit: float
    link: int
    place: PlaceOdds | None = None

    def sentence(self, origin: float) -> str:
        """Returns what to tell a user; times since `origin` s."""
        how = f"contact at t = {self.begin - origin:.2f} s for {self.end - self.begin:.2f} s"
        force = "no valid force" if self.force is None else f"up to {self.force:.3g} N"
        if self.place is not None:
            return f"{how}, {force}, {self._place(self.place)}"
        where = ""
        if self.misfit > 0.0:
            where = f", not at E: link {self.link}" if self.link else ", not at E"
        return f"{how}, {force}{where}"

    @property
    def not_at_E(self) -> bool:
        """Whether a link before the last explains most of it better than E does."""
        return self.misfit > 0.5

    def _place(self, place: PlaceOdds) -> str:
        """Every place that is named, likeliest first; E and the link that carries it are one."""
        bodies, last = place.bodies, len(place.links)
        words = [
            ("at E or on link " if k == last and not self.not_at_E else "on link ")
            + f"{k} ({100.0 * bodies[k - 1]:.0f} %)"
            for k in place.named()
        ]
        return ("not at E: " if self.not_at_E else "") + ", or ".join(words)

    def metrics(self) -> dict[str, Any]:
        """As metrics.json lists it."""
        result: dict[str, Any] = {
            "begin_s": self.begin,
            "end_s": self.end,
            "largest_statistic": self.statistic,
            "largest_force_n": self.force,
            "misfit_pct": 100.0 * self.misfit,
            "link": self.link or None,
        }
        if self.place is not None:
            bodies, links = self.place.bodies, self.place.named()
            result["at_e_pct"] = 100.0 * self.place.at_E
            result["not_at_e"] = self.not_at_E
            result["links"] = [{"link": k, "odds_pct": 100.0 * bodies[k - 1]} for k in links]
        return result


class ContactEpisodes:
    """Gathers contacts chunk by chunk.

    Args:
        num_joints: n.
        gap: s, between two contacts that count as one.
    """

    def __init__(self, num_joints: int, gap: float = GAP) -> None:
        self._gap = gap
        self._n = num_joints
        self.contacts: list[Contact] = []
        self.num_contacts = 0
        self._count = 0
        self._shares = dict.fromkeys(("contact", "misfit", "rest", "out_of_range"), 0)
        self._first: float | None = None
        self._open: Contact | None = None
        self._samples, self._misfits = 0, 0
        self._links = np.zeros(num_joints + 1)
        self._odds = np.zeros(num_joints + 1)  # summed over samples: link 1 to n, E

    def add(
        self,
        t: Array,
        detection: Detection,
        force: Array,
        valid: Flags,
        odds: Array | None = None,
    ) -> None:
        """Takes the next samples.

        Args:
            t: (N,) s.
            detection: of them.
            force: (N, 3) N.
            valid: (N,).
            odds: (N, n + 1) of each link and of E, where they were judged.
        """
        if not len(t):
            return
        self._first = float(t[0]) if self._first is None else self._first
        self._count += len(t)
        for name in self._shares:
            self._shares[name] += int(getattr(detection, name).sum())
        size = np.linalg.norm(force, axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], detection.contact, [False]])))
        for begin, end in edges.reshape(-1, 2):
            rows = slice(int(begin), int(end))
            if self._open is not None and float(t[begin]) - self._open.end > self._gap:
                self._close()
            if self._open is None:
                self._open = Contact(float(t[begin]), float(t[begin]), 0.0, None, 0.0, 0)
                self._samples, self._misfits = 0, 0
                self._links[:] = 0.0
                self._odds[:] = 0.0
            own = self._open
            own.end = float(t[end - 1])
            own.statistic = max(own.statistic, float(detection.statistic[rows].max()))
            trusted = size[rows][valid[rows]]
            if len(trusted):
                own.force = max(own.force or 0.0, float(trusted.max()))
            self._samples += rows.stop - rows.start
            self._misfits += int(detection.misfit[rows].sum())
            if odds is not None:
                self._odds += odds[rows].sum(axis=0)
            links = detection.link[rows][detection.misfit[rows]]
            self._links += np.bincount(links, minlength=self._n + 1)

    def finish(self) -> None:
        """Ends the last contact; nothing follows it."""
        if self._open is not None:
            self._close()

    def _close(self) -> None:
        own = self._open
        assert own is not None
        own.misfit = self._misfits / self._samples
        if self._links[1:].sum() > self._links[0]:
            own.link = 1 + int(np.argmax(self._links[1:]))
        if self._odds.any():
            odds = self._odds / self._odds.sum()
            own.place = PlaceOdds(odds[:-1], float(odds[-1]))
        self.num_contacts += 1
        if len(self.contacts) < KEPT:
            self.contacts.append(own)
        self._open = None

    def metrics(self, false_alarms_per_hour: float | None = None) -> dict[str, Any]:
        """As metrics.json holds them under `contact`; a rate of None: none is stated."""
        share = 100.0 / max(self._count, 1)
        return {
            "false_alarms_per_hour": false_alarms_per_hour,
            "count": self.num_contacts,
            **{f"{name}_pct": share * count for name, count in self._shares.items()},
            "contacts": [own.metrics() for own in self.contacts],
        }

    def lines(self) -> list[str]:
        """What the command prints."""
        if not self.contacts:
            return ["no contact found"]
        first = self._first or 0.0
        origin = first if abs(first) >= FAR_CLOCK else 0.0
        lines = [own.sentence(origin) for own in self.contacts[:SHOWN]]
        more = self.num_contacts - len(lines)
        return lines + ([f"and {more} contacts more, see metrics.json"] if more > 0 else [])
