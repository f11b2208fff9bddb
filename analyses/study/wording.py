"""Words for what figures say, so that a note of the report holds whatever they are."""

from collections.abc import Iterable


def change(reduction: float, digits: int = 1) -> str:
    """A reduction in percent as "12.3 % less"; a negative one as "12.3 % more"."""
    text = f"{abs(reduction):.{digits}f}"
    if float(text) == 0.0:
        return "no less"
    return f"{text} % {'less' if reduction > 0.0 else 'more'}"


def change_between(before: float, after: float, digits: int = 0) -> str:
    """How much less, or more, `after` is than `before`, which is positive, in percent."""
    return change(100.0 * (1.0 - after / before), digits)


def compared(value: float, other: float, less: str, more: str, alike: str, within: float) -> str:
    """One of three texts: `value` is less, more, or within that share of `other`."""
    if abs(value - other) <= within * abs(other):
        return alike
    return less if value < other else more


def listed(words: Iterable[str], nothing: str = "none") -> str:
    """Words as "a, b and c"."""
    *others, last = list(words) or [nothing]
    return f"{', '.join(others)} and {last}" if others else last
