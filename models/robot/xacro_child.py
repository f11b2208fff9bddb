"""The child process that expands a xacro file, URDF to standard output.

Its words: FILE [NAME:=VALUE ...] PACKAGES_FOLLOW [PACKAGE:=FOLDER ...].
"""

import sys
import types
from collections.abc import Mapping
from pathlib import Path

from wrenchsight.models.robot.limited_child import limit_process
from wrenchsight.models.robot.ros_packages import PACKAGE_NOT_FOUND, find_package

PACKAGES_FOLLOW = "--packages"
"""The word before packages that are not found by their names, with their folders."""

_MEMORY_LIMIT = 1 << 30  # bytes


def _give_packages(start: Path, renamed: Mapping[str, str]) -> None:
    """Stands in for ROS's index of packages, which xacro asks for `$(find package)`."""

    def get_package_share_directory(name: str) -> str:
        folder = find_package(name, start) or renamed.get(name)
        if folder is None:
            raise LookupError(
                f'package "{name}" {PACKAGE_NOT_FOUND} around {start} nor on ROS_PACKAGE_PATH or '
                "AMENT_PREFIX_PATH"
            )
        return str(folder)

    index, packages = types.ModuleType("ament_index_python"), types.ModuleType("packages")
    packages.get_package_share_directory = get_package_share_directory  # type: ignore[attr-defined]
    packages.PackageNotFoundError = LookupError  # type: ignore[attr-defined]
    index.packages = packages  # type: ignore[attr-defined]
    sys.modules |= {"ament_index_python": index, "ament_index_python.packages": packages}


def _cause(error: BaseException) -> BaseException:
    """The package that is not found, which xacro wraps; else the error itself."""
    inner: BaseException | None = error
    while inner is not None:
        if PACKAGE_NOT_FOUND in str(inner) and isinstance(inner, LookupError):
            return inner
        inner = getattr(inner, "exc", None) or inner.__cause__ or inner.__context__
    return error


def main(words: list[str]) -> int:
    """Expands FILE with its arguments; returns the exit code."""
    limit_process(_MEMORY_LIMIT)
    path = Path(words[0]).resolve()
    split = words.index(PACKAGES_FOLLOW)
    arguments, renamed = (
        {name: value for name, _, value in (word.partition(":=") for word in part)}
        for part in (words[1:split], words[split + 1 :])
    )
    _give_packages(path.parent, renamed)
    import xacro

    try:
        document = xacro.process_file(str(path), mappings=arguments)
        text = document.toprettyxml(indent="  ", encoding="utf-8")  # messages name its lines
    # What xacro raises has no common class, and SystemExit is among it.
    except (Exception, SystemExit) as error:
        cause = _cause(error)
        print(" ".join(str(cause).split()) or type(cause).__name__, file=sys.stderr)
        return 1
    sys.stdout.buffer.write(text)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
