"""Registry of the kinds of observers, by their configurations."""

import re
from typing import TYPE_CHECKING, Any, Union

from wrenchsight.models.observers import observer
from wrenchsight.models.observers.kalman_observer import KalmanObserver
from wrenchsight.models.observers.momentum_observer import MomentumObserver

OBSERVERS: list[type[observer.Observer]] = [
    MomentumObserver,
    KalmanObserver,
]
"""The first one is the default. To add a kind: one line here, or one `OBSERVERS.append` in another
program."""

if TYPE_CHECKING:
    AnyObserverConfig = Any
else:
    AnyObserverConfig = Union[tuple(kind.Config for kind in OBSERVERS)]  # noqa: UP007
    """The field `observer` of a YAML file: of the default kind, or with the tag of another."""


def kind_name(kind: type[observer.Observer]) -> str:
    """Its name on the command line: `MomentumObserver` is "momentum"."""
    words = re.findall("[A-Z][a-z]*", kind.__name__.removesuffix("Observer"))
    return "-".join(words).lower()


def kind_of(config: Any) -> type[observer.Observer] | None:
    """The kind that a configuration belongs to; None where none is registered."""
    return next((kind for kind in OBSERVERS if type(config) is kind.Config), None)


def make_observer(config: Any, num_joints: int) -> observer.Observer:
    """Returns the observer of a configuration.

    Raises:
        ValueError: no kind of observer has such a configuration, or it makes no sense.
    """
    kind = kind_of(config)
    if kind is not None:
        return kind(config, num_joints)
    config_names = ", ".join(kind.Config.__name__ for kind in OBSERVERS)
    raise ValueError(f"observer: expected one of {config_names}, not {type(config).__name__}")
