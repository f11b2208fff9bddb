"""Reads a MATLAB file's arrays of numbers and writes them to the standard output as an npz file.

A process of its own: a damaged file can break scipy's reader. See `robot.limited_child`.
"""

import io
import sys
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.robot.limited_child import limit_process

MEMORY_LIMIT: Final = 3 << 30  # bytes of addresses, of which the libraries take a third
_MOST_ELEMENTS: Final = 256  # of an array of structures
_MOST_DEPTH: Final = 4  # of structures within structures


def variables(path: str) -> Iterator[tuple[str, NDArray[Any]]]:
    """The arrays of numbers and of lines of text of a file, by name."""
    from scipy.io import loadmat

    content: dict[str, Any] = loadmat(path, appendmat=False, squeeze_me=False)
    for name, value in content.items():
        if not name.startswith("__"):
            yield from _numbers(name, value, 0)


def _numbers(name: str, value: Any, depth: int) -> Iterator[tuple[str, NDArray[Any]]]:
    array = np.asarray(value)
    if array.dtype.names and array.size == 1 and depth < _MOST_DEPTH:
        for field in array.dtype.names:
            yield from _numbers(f"{name}.{field}", array.reshape(-1)[0][field], depth + 1)
    elif array.dtype.names and array.size <= _MOST_ELEMENTS and depth < _MOST_DEPTH:
        for k, element in enumerate(array.reshape(-1)):  # such as the signals of a Simulink scope
            label = str(np.asarray(element["label"]).ravel()[0]) if _has_label(element) else ""
            for field in array.dtype.names:
                yield from _numbers(f"{name}.{label or k + 1}.{field}", element[field], depth + 1)
    elif array.dtype.kind in "iufb" and array.ndim == 2 and array.size:
        yield name, array
    elif array.dtype.kind == "U" and array.ndim == 1 and array.size > 1:  # such as dates
        yield name, array[:, None]


def _has_label(element: Any) -> bool:
    """Whether an element of a structure has a text that labels it."""
    if "label" not in (element.dtype.names or ()):
        return False
    label = np.asarray(element["label"])
    return label.dtype.kind == "U" and label.size == 1


if __name__ == "__main__":
    limit_process(MEMORY_LIMIT)
    try:
        arrays: dict[str, Any] = dict(variables(sys.argv[1]))
        buffer = io.BytesIO()
        np.savez(buffer, **{f"x{k}": x for k, x in enumerate(arrays.values())},
                 names=np.array(list(arrays), dtype=np.str_))  # fmt: skip
        sys.stdout.buffer.write(buffer.getvalue())
    except Exception as error:
        sys.exit(f"{error}"[:300] or type(error).__name__)
