"""What is used of `numba.extending`."""

from collections.abc import Callable
from typing import Any, TypeVar

_Choice = TypeVar("_Choice", bound=Callable[..., Any])

def overload(
    function: Callable[..., Any], *, inline: str = ...
) -> Callable[[_Choice], _Choice]: ...
def __getattr__(name: str) -> Any: ...
