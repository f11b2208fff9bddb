"""Notes of the report, whose figures are taken from the metrics of the run."""

import re
from collections.abc import Iterable, Mapping
from typing import Any, Final

from wrenchsight.analyses.output.outputs import plain_metrics
from wrenchsight.analyses.study.outcome import look_up

_FIGURE: Final = re.compile(r"<([^<>:]+):(?:([\de.]+) )?([^<> ]*)>")


def filled(notes: Iterable[str], metrics: Mapping[str, Any]) -> list[str]:
    """Notes with the figures that they name.

    `<key:.2f>` is the metric at the path `key` in this format, all members of a list side by side;
    `<key:100 .0f>` is a hundred times the metric. A value that is not finite becomes a dash.

    Args:
        notes: sentences. One that names a metric that the run lacks is left out.
        metrics: nested, of the run.

    Raises:
        ValueError, TypeError: a metric is there, but cannot be written in its format.
    """
    plain = plain_metrics(dict(metrics))

    def figure(match: "re.Match[str]") -> str:
        key, scale, spec = match.groups()
        found = look_up(plain, key)
        values = found if isinstance(found, list) else [found]
        return " ".join(
            "–" if value is None else format(value if scale is None else float(scale) * value, spec)
            for value in values
        )

    def is_measured(note: str) -> bool:
        try:
            for match in _FIGURE.finditer(note):
                look_up(plain, match[1])
        except ValueError:  # of `look_up`: the run lacks it
            return False
        return True

    return [_FIGURE.sub(figure, note) for note in notes if is_measured(note)]
