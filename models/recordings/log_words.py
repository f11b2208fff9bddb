"""Words of `--log-format` that say what a log's own names leave open, instead of a description."""

from dataclasses import dataclass
from pathlib import Path

IN_AMPERES, IN_NEWTON_METRES = "effort-in-amperes", "effort-in-newton-metres"
IN_DEGREES, IN_RADIANS = "positions-in-degrees", "positions-in-radians"
WORDS = (IN_AMPERES, IN_NEWTON_METRES, IN_DEGREES, IN_RADIANS)


@dataclass(frozen=True)
class LogWords:
    """What the words say; empty: nothing."""

    effort: str = ""  # unit of what the log calls effort: A or N m
    angle: str = ""  # unit of positions whose unit the log does not say: deg or rad

    def angle_words(self) -> tuple[str, ...]:
        """The word that says `angle`; none where it is empty."""
        return {"deg": (IN_DEGREES,), "rad": (IN_RADIANS,)}.get(self.angle, ())


def log_words(description: str | Path | None) -> LogWords | None:
    """What `--log-format` says in words, one or several with commas; None: it is a description."""
    given = [word.strip() for word in str(description or "").split(",")]
    if not all(word in WORDS for word in given):
        return None
    effort = "A" if IN_AMPERES in given else "N m" if IN_NEWTON_METRES in given else ""
    angle = "deg" if IN_DEGREES in given else "rad" if IN_RADIANS in given else ""
    return LogWords(effort, angle)
