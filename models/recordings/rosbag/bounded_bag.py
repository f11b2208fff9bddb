"""The readers of `rosbags` with a bound on the size of decompressed data.

A chunk of zeros compresses to a thousandth: without a bound, a small file fills memory or the disk.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO, Final, NamedTuple

from wrenchsight.models.recordings.packed_file import refuse_ratio
from wrenchsight.models.recordings.rosbag.messages import (
    Deserialize,
    ros1_typestore,
    typestore,
)

LARGEST_PART: Final = 1 << 26  # bytes of one chunk or message
ROS1_SUFFIX: Final = ".bag"


class OpenedBag(NamedTuple):
    """A bag of ROS 1 or ROS 2.

    Attributes:
        reader: a `rosbags.rosbag1.Reader` or `rosbags.rosbag2.Reader`, opened.
        deserialize: makes a message of its bytes.
    """

    reader: Any
    deserialize: Deserialize


@contextmanager
def bounded_reader(path: Path) -> Iterator[OpenedBag]:
    """An opened bag.

    Raises:
        ValueError: the bag decompresses to more than the bound; also while its messages are read.
        Exception: of any kind, raised by rosbags over a damaged bag.
    """
    opened = _ros1_bag if path.suffix.lower() == ROS1_SUFFIX else _ros2_bag
    with opened(path) as bag:
        yield bag


@contextmanager
def _ros1_bag(path: Path) -> Iterator[OpenedBag]:
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1 import reader as rosbags_reader

    rosbags_reader.decompressors["bz2"] = _bz2
    rosbags_reader.decompressors["lz4"] = _lz4
    rosbags_reader.read_bytes = _read_bytes
    with Reader(path) as reader:
        yield OpenedBag(reader, ros1_typestore().deserialize_ros1)


@contextmanager
def _ros2_bag(path: Path) -> Iterator[OpenedBag]:
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
            refuse_ratio(declared, storage.path.stat().st_size)
        yield OpenedBag(reader, typestore().deserialize_cdr)


def _refuse_packed_files(folder: Path) -> None:
    """Measures compressed files by decompressing them once: rosbags would do so to the disk."""
    from backports import zstd

    for path in folder.glob("*.zstd"):
        unpacked = 0
        with zstd.open(path, "rb") as file:
            while block := file.read(1 << 20):
                unpacked += len(block)
                refuse_ratio(unpacked, path.stat().st_size)


def _read_bytes(source: BinaryIO, size: int) -> bytes:
    """As `rosbags.rosbag1.reader.read_bytes`; a stated size allocates no memory of its own."""
    _refuse_part(size)
    data = source.read(size)
    if len(data) != size:
        raise ValueError(f"{len(data)} of {size} bytes")
    return data


def _zstd(data: bytes, size: int = LARGEST_PART) -> bytes:
    from backports.zstd import ZstdDecompressor

    _refuse_part(size)
    content = bytes(ZstdDecompressor().decompress(data, max_length=size + 1))
    _refuse_part(len(content))
    return content


def _lz4(data: bytes, size: int = LARGEST_PART) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    _refuse_part(size)
    content = bytes(LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    _refuse_part(len(content))
    return content


def _bz2(data: bytes) -> bytes:
    from bz2 import BZ2Decompressor

    content = BZ2Decompressor().decompress(data, max_length=LARGEST_PART + 1)
    _refuse_part(len(content))
    return content


def _refuse_part(size: int) -> None:
    if size > LARGEST_PART:
        raise ValueError(f"a chunk of {size} bytes, at most {LARGEST_PART} are read")
