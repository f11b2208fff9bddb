"""Words of `--log-format` that state units which a log leaves open, instead of a description."""

from dataclasses import dataclass
from pathlib import Path

IN_AMPERES, IN_NEWTON_METRES = "effort-in-amperes", "effort-in-newton-metres"
IN_DEGREES, IN_RADIANS = "positions-in-degrees", "positions-in-radians"
WORDS = (IN_AMPERES, IN_NEWTON_METRES, IN_DEGREES, IN_RADIANS)
_EFFORT_UNITS = {IN_AMPERES: "A", IN_NEWTON_METRES: "N m"}
_ANGLE_UNITS = {IN_DEGREES: "deg", IN_RADIANS: "rad"}


@dataclass(frozen=True)
class LogWords:
    """The units that the words state; empty where none is stated."""

    effort: str = ""  # unit of what the log calls effort: A or N m
    angle: str = ""  # unit of positions whose unit the log does not say: deg or rad

    def angle_words(self) -> tuple[str, ...]:
        """The word that states `angle`; none where it is empty."""
        return {"deg": (IN_DEGREES,), "rad": (IN_RADIANS,)}.get(self.angle, ())


def log_words(description: str | Path | None) -> LogWords | None:
    """The units that the words of `--log-format` state; None where it names a description.

    Args:
        description: the option's value; several words are separated by commas.
    """
    words = [word.strip() for word in str(description or "").split(",")]
    if not all(word in WORDS for word in words):
        return None
    return LogWords(_first_unit(_EFFORT_UNITS, words), _first_unit(_ANGLE_UNITS, words))


def _first_unit(units: dict[str, str], words: list[str]) -> str:
    """The unit of the first entry of `units` whose word is among the words."""
    return next((unit for word, unit in units.items() if word in words), "")
