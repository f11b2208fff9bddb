"""The reader of `rosbags` with a bound on the size of decompressed data.

A chunk of zeros compresses to a thousandth: without a bound, a small file fills memory or the disk.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

LARGEST_PART: Final = 1 << 26  # bytes of one chunk or message
_LARGEST_FILE: Final = 1 << 28  # bytes of a decompressed file, or
_LARGEST_RATIO: Final = 50  # times its compressed size, whichever is more


@contextmanager
def bounded_reader(path: Path) -> Iterator[Any]:
    """An opened `rosbags.rosbag2.Reader`.

    Raises:
        ValueError: the bag decompresses to more than the bound; also while its messages are read.
        Exception: of any kind, raised by rosbags over a damaged bag.
    """
    from backports import zstd
    from rosbags.rosbag2 import Reader, storage_mcap
    from rosbags.rosbag2 import reader as rosbags_reader

    rosbags_reader.zstd = SimpleNamespace(open=zstd.open, decompress=_zstd)
    storage_mcap.DECOMPRESSORS["zstd"] = _zstd
    storage_mcap.DECOMPRESSORS["lz4"] = _lz4
    if path.is_dir():
        _refuse_packed_files(path)
    with Reader(path) as reader:
        storages = getattr(reader.storage, "storages", [reader.storage])
        for storage in storages:
            declared = sum(chunk.uncompressed_size for chunk in getattr(storage, "chunks", ()))
            _refuse_above(declared, storage.path.stat().st_size)
        yield reader


def _refuse_above(size: int, packed: int) -> None:
    """Refuses a decompressed size that is beyond the bound of its compressed size."""
    if size > max(_LARGEST_FILE, _LARGEST_RATIO * packed):
        raise ValueError(f"{packed} bytes that unpack to {size} or more")


def _refuse_packed_files(folder: Path) -> None:
    """Measures compressed files by decompressing them once: rosbags would do so to the disk."""
    from backports import zstd

    for path in folder.glob("*.zstd"):
        unpacked = 0
        with zstd.open(path, "rb") as file:
            while block := file.read(1 << 20):
                unpacked += len(block)
                _refuse_above(unpacked, path.stat().st_size)


def _zstd(data: bytes, size: int = LARGEST_PART) -> bytes:
    from backports.zstd import ZstdDecompressor

    _refuse_part(size)
    content = bytes(ZstdDecompressor().decompress(data, max_length=size + 1))
    _refuse_part(len(content))
    return content


def _lz4(data: bytes, size: int) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    _refuse_part(size)
    return bytes(LZ4FrameDecompressor().decompress(data, max_length=size + 1))


def _refuse_part(size: int) -> None:
    if size > LARGEST_PART:
        raise ValueError(f"a chunk of {size} bytes, at most {LARGEST_PART} are read")
