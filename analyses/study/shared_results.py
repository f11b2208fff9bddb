"""Results that several experiments of a study share; the first that needs one computes it.

A study gives its experiments' processes a folder (`sharing_in`); there `shared` keeps what a
function returned, under a digest of its arguments. The folder is made and removed by the study: no
result of other software, or of anyone else's making, is ever read back. Outside a study every call
computes.
"""

import dataclasses
import hashlib
import pickle
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar
from xml.etree import ElementTree

import numpy as np
from filelock import FileLock

from wrenchsight.models.files.whole_file import whole_file

Result = TypeVar("Result")

_KEY_DIGITS: int = 24  # hexadecimal, of a digest in a file's name: enough that no two agree

_folders: ContextVar[tuple[Path, Path] | None] = ContextVar("shared results", default=None)


@contextmanager
def sharing_in(folder: Path, everywhere: Path | None = None) -> Iterator[None]:
    """Shares results through folders, which exist, inside the block.

    Args:
        folder: folder of a study, or of one world of a campaign.
        everywhere: for what is the same in all worlds; None: `folder`.
    """
    token = _folders.set((folder, folder if everywhere is None else everywhere))
    try:
        yield
    finally:
        _folders.reset(token)


def shared(
    name: str, arguments: tuple[Any, ...], compute: Callable[[], Result], everywhere: bool = False
) -> Result:
    """Returns what `compute` returns, computed once for all that share the folder.

    A process that needs a result while another computes it waits. The result is read back from
    the file also where it was computed, so that all go on with the same bytes in the same layout.

    Args:
        name: name of what is computed.
        arguments: all that it depends on; what is left out is not seen to differ.
        compute: returns something that can be pickled, and has no other effect.
        everywhere: whether all worlds share it, since the simulated truth has no part in it.

    Raises:
        InputError: the result cannot be written, for lack of space for instance.
    """
    folders = _folders.get()
    if folders is None:
        return compute()
    of_this_world, of_all_worlds = folders
    folder = of_all_worlds if everywhere else of_this_world
    key = f"{name}-{digest(arguments)[:_KEY_DIGITS]}"
    path = folder / f"{key}.pickle"
    with FileLock(folder / f"{key}.lock"):  # released by the system if this process dies
        if not path.exists():
            content = pickle.dumps(compute(), protocol=pickle.HIGHEST_PROTOCOL)
            with whole_file(path) as partial:
                partial.write_bytes(content)
    result: Result = pickle.loads(path.read_bytes())
    return result


def digest(value: Any) -> str:
    """Returns the SHA-256 of a value: numbers, text, arrays, containers and objects made of them.

    Equal values have equal digests in every process; cached properties do not count.
    """
    sha = hashlib.sha256()
    for part in _parts(value):
        sha.update(part)
    return sha.hexdigest()


def _parts(value: Any) -> Iterator[bytes]:
    """What a digest of a value is made of: the types with their names, and the contents.

    The order of a mapping's keys, of a set and of an object's attributes does not count. What is
    neither a container nor has attributes counts by its pickle. A change here makes all digests
    others, and so all shared results anew.

    The kinds are tried in this order: an XML element and a mapping may have attributes, too.
    """
    kind = type(value)
    yield f"{kind.__module__}.{kind.__qualname__}(".encode()
    if value is None or isinstance(value, bool | int | float | complex | str | bytes | Path):
        yield repr(value).encode()
    elif isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
        yield f"{value.dtype.str}{value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, ElementTree.Element):  # its pickle varies with its origin
        yield ElementTree.tostring(value)
    elif isinstance(value, Mapping):
        yield from _unordered({digest(k): v for k, v in value.items()})
    elif isinstance(value, set | frozenset):
        yield from _unordered(dict.fromkeys(map(digest, value)))
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _parts(item)
    elif dataclasses.is_dataclass(value) or hasattr(value, "__dict__"):
        names = (
            [field.name for field in dataclasses.fields(value)]
            if hasattr(value, "__dataclass_fields__")
            else list(vars(value))
        )
        # A cached property is in `vars` once it was read: it follows from the rest.
        stored_names = (n for n in names if not isinstance(getattr(kind, n, None), cached_property))
        yield from _unordered({name: getattr(value, name) for name in stored_names})
    else:
        yield pickle.dumps(value)
    yield b")"


def _unordered(items: Mapping[str, Any]) -> Iterator[bytes]:
    for name in sorted(items):
        yield f"{name}=".encode()
        yield from _parts(items[name])
