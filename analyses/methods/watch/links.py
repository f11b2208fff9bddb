"""What opens a source, publisher, view or player, from its own file: imported when it is wanted."""

from collections.abc import Callable
from contextlib import nullcontext
from importlib import import_module
from operator import attrgetter
from typing import Any

from wrenchsight.models.files.input_error import needing_extra


def link(place: str, extra: str = "", option: str = "") -> Callable[..., Any]:
    """What stands at FILE:NAME of this sub-package, to be called.

    Args:
        extra: extra of this package, to which belongs what the file imports.
        option: that a problem names; else the URL's scheme, which is the extra's name.
    """
    file, _, name = place.partition(":")

    def opened(*given: Any) -> Any:
        with needing_extra(extra, option or f"{extra}://") if extra else nullcontext():
            module = import_module(f"{__package__}.{file}")
        return attrgetter(name)(module)(*given)

    return opened
