"""Names of results that are made from files' names, of which several may be the same."""

from collections.abc import Sequence


def distinct_names(names: Sequence[str]) -> list[str]:
    """The names in their order; a repeated one gets a number: NAME, NAME_2, NAME_3."""
    distinct: list[str] = []
    for name in names:
        candidate, count = name, 1
        while candidate in distinct:
            count += 1
            candidate = f"{name}_{count}"
        distinct.append(candidate)
    return distinct
