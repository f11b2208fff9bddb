"""Logs that are compressed as a whole (`log.mcap.zstd`, `log.csv.gz`, `log.zip` of one file),
unpacked within a bound.

A file of zeros compresses to a thousandth: without a bound, a small file fills the disk.
"""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened

_LARGEST_FILE: Final = 1 << 28  # bytes of a decompressed file, or
_LARGEST_RATIO: Final = 50  # times its compressed size, whichever is more
_BLOCK_BYTES: Final = 1 << 20
_LISTED_MEMBERS: Final = 6  # of an archive, in an error line


def refuse_ratio(size: int, packed: int) -> None:
    """Refuses a decompressed size that is beyond the bound of its compressed size.

    Raises:
        ValueError: it is.
    """
    if size > max(_LARGEST_FILE, _LARGEST_RATIO * packed):
        raise ValueError(f"{packed} bytes that unpack to {size} or more")


def _gzip(file: Any) -> Any:
    import gzip

    return gzip.open(file, "rb")


def _bz2(file: Any) -> Any:
    import bz2

    return bz2.open(file, "rb")


def _xz(file: Any) -> Any:
    import lzma

    return lzma.open(file, "rb")


def _zstd(file: Any) -> Any:
    from backports import zstd

    return zstd.open(file, "rb")


def _lz4(file: Any) -> Any:
    import lz4.frame

    return lz4.frame.open(file, "rb")


def _zip(file: Any) -> Any:
    import zipfile

    archive = zipfile.ZipFile(file)
    return archive.open(_only_member(archive))


def _only_member(archive: Any) -> str:
    """The only file of an archive, without what macOS adds.

    Raises:
        ValueError: there is none, or there are several.
    """
    names = [str(name) for name in archive.namelist()]
    files = [name for name in names if not name.endswith("/") and "__MACOSX" not in name]
    if len(files) != 1:
        listed = ", ".join(files[:_LISTED_MEMBERS]) or "none"
        raise ValueError(f"{len(files)} files: {listed}; expected one")
    return files[0]


_UNPACKERS: Final[dict[str, Callable[[Any], Any]]] = {
    ".gz": _gzip,
    ".bz2": _bz2,
    ".xz": _xz,
    ".zst": _zstd,
    ".zstd": _zstd,
    ".lz4": _lz4,
    ".zip": _zip,
}


class UnpackedFile:
    """The content of a packed file on the disk; it is removed with this object.

    Args:
        path: path of a packed file, `is_packed`.

    Attributes:
        path: path of the unpacked file, whose name is that of the packed one without its last
            ending; in an archive it has a name of its own.

    Raises:
        InputError: it cannot be read, is damaged, or unpacks to more than the bound.
    """

    def __init__(self, path: Path) -> None:
        self._packed = path
        self._folder = tempfile.TemporaryDirectory(prefix="wrenchsight", ignore_cleanup_errors=True)
        self.path = Path(self._folder.name) / _name_within(path)
        packed = path.stat().st_size
        unpacked = 0
        try:
            with (
                opened(path, "a log") as raw,
                self.path.open("wb") as target,
                _UNPACKERS[path.suffix.lower()](raw) as source,
            ):
                while block := source.read(_BLOCK_BYTES):
                    unpacked += len(block)
                    refuse_ratio(unpacked, packed)
                    target.write(block)
        except InputError:
            raise
        except Exception as error:  # each kind of compression has errors of its own
            problem = f"cannot be unpacked ({str(error)[:200] or type(error).__name__})"
            raise InputError(path, "", problem, "unpack it by hand, or record it again") from error

    @contextmanager
    def errors_of_packed(self) -> Iterator[None]:
        """Lets errors about the unpacked file name the packed one: the user knows no other.

        Raises:
            InputError: one was raised in the block.
        """
        try:
            yield
        except InputError as error:
            own, line = f"{self.path}: ", str(error)
            if not line.startswith(own):
                raise
            raise InputError(self._packed, "", line.removeprefix(own)) from error


def is_packed(path: Path) -> bool:
    """Whether a file is compressed as a whole, by the ending of its name."""
    return path.suffix.lower() in _UNPACKERS and path.is_file()


def _name_within(path: Path) -> str:
    """The name of the unpacked file; of an archive that cannot be read, that of the archive."""
    if path.suffix.lower() == ".zip":
        import zipfile

        with suppress(OSError, ValueError, zipfile.BadZipFile), zipfile.ZipFile(path) as archive:
            return Path(_only_member(archive)).name
    return path.stem
