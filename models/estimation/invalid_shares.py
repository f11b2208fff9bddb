"""Shares of the readings that are not valid, reason by reason, and the line that says so.

A reading counts for the first of its reasons, so that the shares add up.
"""

from wrenchsight.models.estimation.invalid import REASONS, InvalidCodes
from wrenchsight.models.estimation.wrench import ValidityLimits

LEAST_NAMED_SHARE = 0.0005  # of all readings: less is 0.0 % in the line


def invalid_pct(invalid: InvalidCodes) -> dict[str, float]:
    """Percent of N readings (N,) by the keys of their reasons; see `InvalidShares.metrics`."""
    shares = InvalidShares()
    shares.add(invalid)
    return shares.metrics()


class InvalidShares:
    """Counts of readings, added up part by part.

    Attributes:
        count: count of all readings.
        num_valid: number of the valid ones.
    """

    def __init__(self) -> None:
        self.count = 0
        self.num_valid = 0
        self._counts = dict.fromkeys(REASONS, 0)

    def add(self, invalid: InvalidCodes) -> None:
        """Takes the reasons (N,) of N readings."""
        remaining = invalid[invalid != 0]
        self.count += len(invalid)
        self.num_valid += len(invalid) - len(remaining)
        for code in REASONS:
            has_reason = (remaining & code) != 0
            self._counts[code] += int(has_reason.sum())
            remaining = remaining[~has_reason]

    def share(self, code: int) -> float:
        """Share of the readings, 0 to 1, that are not valid for this reason first."""
        return self._counts[code] / max(self.count, 1)

    @property
    def largest(self) -> int:
        """The reason with the largest share; 0 where all readings are valid."""
        code = max(REASONS, key=self._counts.__getitem__)
        return code if self._counts[code] else 0

    def metrics(self) -> dict[str, float]:
        """Percent of the readings by the reasons' keys, of those that occur."""
        shares = {words.key: 100.0 * self.share(code) for code, words in REASONS.items()}
        return {f"{key}_pct": share for key, share in shares.items() if share > 0.0}

    def sentence(self, limits: ValidityLimits) -> str:
        """One line: the share of all readings that are not valid, and of each reason.

        Args:
            limits: limits of a valid reading.
        """
        codes = [code for code in REASONS if self.share(code) >= LEAST_NAMED_SHARE]
        codes.sort(key=self.share, reverse=True)
        total = 1.0 - self.num_valid / max(self.count, 1)
        if not codes:
            return f"{100.0 * total:.1f} % not valid"
        values = limits._asdict()
        parts = [
            f"{100.0 * self.share(code):.1f} % {REASONS[code].label.format(**values)}"
            for code in codes
        ]
        return f"{100.0 * total:.1f} % not valid: " + ", ".join(parts)

    def sentences(self, limits: ValidityLimits) -> tuple[str, ...]:
        """That line, and what would help most; empty where all readings are valid."""
        if not self.largest:
            return ()
        return (self.sentence(limits), f"what would help: {REASONS[self.largest].remedy}")
