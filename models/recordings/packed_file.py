"""Logs that are compressed as a whole (`log.mcap.zstd`, `log.csv.gz`), or lie in an archive of one
log (`log.zip`, `log.tar.gz`), unpacked within a bound.

A file of zeros compresses to a thousandth: without a bound, a small file fills the disk.
"""

import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
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
    name = _only_log([n for n in archive.namelist() if not n.endswith("/")])
    return _Member(archive.open(name), name)


def _tar(file: Any) -> Any:
    import tarfile

    archive = tarfile.TarFile(fileobj=file)
    name = _only_log([m.name for m in archive.getmembers() if m.isfile()])
    return _Member(archive.extractfile(name), name)


class _Member:
    """A file of an archive, opened, with its name there."""

    def __init__(self, file: Any, name: str) -> None:
        self.name = Path(name).name
        self._file = file

    def read(self, size: int) -> bytes:
        return bytes(self._file.read(size))

    def __enter__(self) -> "_Member":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()


def _only_log(names: Sequence[str]) -> str:
    """The only file of an archive, without what macOS adds and what goes with a log.

    Raises:
        ValueError: there is none, or there are several.
    """
    files = [name for name in names if not _ASIDE.search(name)]
    logs = [name for name in files if not _BESIDE_LOG.search(name)] or files
    if len(logs) != 1:
        listed = ", ".join(logs[:_LISTED_MEMBERS]) or "none"
        raise ValueError(f"{len(logs)} files: {listed}; expected one")
    return logs[0]


_ASIDE: Final = re.compile(r"(^|/)(__MACOSX/|\._|\.DS_Store$)")
_BESIDE_LOG: Final = re.compile(
    r"(^|/)readme[^/]*$|\.(md|ya?ml|png|jpe?g|pdf|svg|html|urdf|xacro|ini|cfg|toml)$", re.IGNORECASE
)
_MAGIC_BYTES: Final = 262
_TAR_MAGIC: Final = slice(257, 262)  # its place, of a tar archive
_UNPACKERS: Final[tuple[tuple[bytes, tuple[str, ...], Callable[[Any], Any]], ...]] = (
    # first bytes, endings, what reads it
    (b"\x1f\x8b", (".gz", ".tgz"), _gzip),
    (b"BZh", (".bz2", ".tbz2"), _bz2),
    (b"\xfd7zXZ", (".xz", ".txz"), _xz),
    (b"\x28\xb5\x2f\xfd", (".zst", ".zstd"), _zstd),
    (b"\x04\x22\x4d\x18", (".lz4",), _lz4),
    (b"", (".tar",), _tar),
    (b"", (".zip",), _zip),
)
_MOST_LAYERS: Final = 3  # such as log.csv in a tar archive that gzip has packed


def _unpacker(path: Path) -> Callable[[Any], Any] | None:
    """What unpacks a file, by its first bytes or its ending; None: it is not packed."""
    if not path.is_file():
        return None
    try:
        with path.open("rb") as file:
            head = file.read(_MAGIC_BYTES)
    except OSError:  # whoever opens it says what is wrong
        return None
    suffix = path.suffix.lower()
    if head[_TAR_MAGIC] == b"ustar":
        return _tar
    for magic, suffixes, unpacker in _UNPACKERS:
        if suffix in suffixes or (magic and head.startswith(magic)):
            return unpacker
    return None


class UnpackedFile:
    """The content of a packed file on the disk; it is removed with this object.

    Args:
        path: path of a packed file, `is_packed`.

    What is in an archive may be packed itself.

    Attributes:
        path: path of the unpacked file, whose name is that of the packed one without its last
            ending; in an archive it has a name of its own.

    Raises:
        InputError: it cannot be read, is damaged, or unpacks to more than the bound.
    """

    def __init__(self, path: Path) -> None:
        self._packed = path
        self._folder = tempfile.TemporaryDirectory(prefix="wrenchsight", ignore_cleanup_errors=True)
        self.path = path
        for layer in range(_MOST_LAYERS):
            unpacker = _unpacker(self.path)
            if unpacker is None:
                break
            folder = Path(self._folder.name) / str(layer)
            folder.mkdir()
            self.path = self._unpacked(self.path, folder, unpacker)

    def _unpacked(self, source: Path, folder: Path, unpacker: Callable[[Any], Any]) -> Path:
        """The file in a packed one, written into a folder.

        Raises:
            InputError: as the class.
        """
        size = unpacked = 0
        path = folder / "log"
        try:
            with opened(source, "a log") as raw, path.open("wb") as target:
                size = source.stat().st_size
                with unpacker(raw) as file:
                    name = file.name if isinstance(file, _Member) else source.stem or "log"
                    while block := file.read(_BLOCK_BYTES):
                        unpacked += len(block)
                        refuse_ratio(unpacked, size)
                        target.write(block)
        except InputError:
            raise
        except Exception as error:  # each kind of compression has errors of its own
            problem = f"cannot be unpacked ({str(error)[:200] or type(error).__name__})"
            raise InputError(
                self._packed, "", problem, "unpack it by hand, or record it again"
            ) from error
        return path.rename(folder / name)

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
    """Whether a file is compressed as a whole, or an archive, by its first bytes or its ending."""
    return _unpacker(path) is not None
