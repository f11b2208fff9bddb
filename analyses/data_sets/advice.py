"""Advice on missing recordings: the command that gets them, or whom to ask."""

from collections.abc import Mapping, Sequence

from wrenchsight.analyses.data_sets.registry import DATA_SETS


def how_to_get(name: str) -> str:
    """How to get one set."""
    return how_to_get_all([name])


def how_to_get_all(names: Sequence[str]) -> str:
    """How to get several sets: one command for all that can be fetched, advice for each other."""
    data_sets = [DATA_SETS[name] for name in names if name in DATA_SETS]
    fetched = [data_set.name for data_set in data_sets if data_set.published]
    parts = [f"`wrenchsight data fetch {' '.join(fetched)}`"] if fetched else []
    parts += [
        f"{data_set.name}: {data_set.advice}" for data_set in data_sets if not data_set.published
    ]
    parts += [f"{name}: give it with --data" for name in names if name not in DATA_SETS]
    return "; ".join(parts)


def missing_recordings(lacks: Mapping[str, Sequence[str]]) -> str:
    """One line on a study's missing recordings: which experiments lack which set, and what to do.

    Args:
        lacks: sets by experiment.
    """
    experiments: dict[str, list[str]] = {}
    for experiment, names in lacks.items():
        for name in names:
            experiments.setdefault(name, []).append(experiment)
    sets = ", ".join(f"{name} ({', '.join(users)})" for name, users in experiments.items())
    return f"missing recordings: {sets}; to get them: {how_to_get_all(list(experiments))}"
