"""wrenchsight: the wrench at an industrial arm's tool, from its motor currents.

    from wrenchsight import IdentifiedModel, Robot, WrenchEstimator

This module offers what users need under one name. Nothing heavy is imported before it is asked for:
`import wrenchsight` itself brings in neither Drake nor numba. It imports next to nothing, so that a
command is soon where an interrupt ends it in one line.
"""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any


def _homes() -> dict[str, str]:
    """Public name -> the module that defines it, as `__init__.pyi` imports it."""
    with open(f"{__file__}i", encoding="utf-8") as stub:  # noqa: PTH123  (pathlib is no light import)
        statements = stub.read().replace("(\n    ", "").splitlines()
    words = [statement.split() for statement in statements if statement.startswith("from ")]
    return {name: module for _, module, _, name, *_ in words}


_HOME = _homes()
__all__ = ["__version__", *_HOME]  # noqa: PLE0604  (the table holds strings)


def __getattr__(name: str) -> "Any":
    """Imports a public name when it is first used.

    Raises:
        AttributeError: the name is not offered.
    """
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            value: Any = version("wrenchsight")
        except PackageNotFoundError:  # a checkout that is not installed
            value = "0+unknown"
    elif name in _HOME:
        from importlib import import_module

        value = getattr(import_module(_HOME[name]), name)
    else:
        raise AttributeError(f"module 'wrenchsight' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
