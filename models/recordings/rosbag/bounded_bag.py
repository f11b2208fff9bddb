"""The readers of `rosbags` with a bound on the size of decompressed data.

A chunk of zeros compresses to a thousandth: without a bound, a small file fills memory or the disk.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO, Final, NamedTuple

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened
from wrenchsight.models.recordings.packed_file import refuse_ratio
from wrenchsight.models.recordings.rosbag.messages import (
    Deserialize,
    ros1_typestore,
    typestore,
)

LARGEST_PART: Final = 1 << 26  # bytes of one chunk or message
ROS1_SUFFIX: Final = ".bag"
ROS1_MAGIC: Final = b"#ROSBAG V2.0"
_MCAP_MAGIC: Final = b"\x89MCAP"
_PROFILE_BEGIN: Final = 8 + 1 + 8 + 4  # bytes: magic, opcode, lengths of record and profile
_HEADER_BYTES: Final = 256  # of a file, which hold the profile


class OpenedBag(NamedTuple):
    """A bag of ROS 1 or ROS 2.

    Attributes:
        reader: a `rosbags.rosbag1.Reader` or `rosbags.rosbag2.Reader`, opened.
        deserialize: makes a message of its bytes.
    """

    reader: Any
    deserialize: Deserialize


def is_ros1_bag(path: Path) -> bool:
    """Whether a file is a ROS 1 bag, by its first bytes or its ending.

    Raises:
        InputError: there is no such file, or it cannot be read.
    """
    if path.is_dir():
        return False
    if path.suffix.lower() == ROS1_SUFFIX:
        return True
    with opened(path, "a log") as file:
        return file.read(len(ROS1_MAGIC)) == ROS1_MAGIC


@contextmanager
def bounded_reader(path: Path) -> Iterator[OpenedBag]:
    """An opened bag.

    Raises:
        ValueError: the bag decompresses to more than the bound; also while its messages are read.
        Exception: of any kind, raised by rosbags over a damaged bag.
    """
    open_bag = _ros1_bag if is_ros1_bag(path) else _ros2_bag
    with open_bag(path) as bag:
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
    elif path.suffix.lower() == ".mcap":
        _refuse_other_messages(path)
    with Reader(path) as reader:
        storages = getattr(reader.storage, "storages", [reader.storage])
        for storage in storages:
            declared = sum(chunk.uncompressed_size for chunk in getattr(storage, "chunks", ()))
            refuse_ratio(declared, storage.path.stat().st_size)
        yield OpenedBag(reader, typestore().deserialize_cdr)


def _refuse_other_messages(path: Path) -> None:
    """Refuses an MCAP file whose messages are not those of ROS 2, by the profile in its header.

    Raises:
        InputError: it states another profile, or none.
    """
    with opened(path, "a log") as file:
        head = file.read(_HEADER_BYTES)
    if not head.startswith(_MCAP_MAGIC):
        return
    size = int.from_bytes(head[_PROFILE_BEGIN - 4 : _PROFILE_BEGIN], "little")
    profile = head[_PROFILE_BEGIN : _PROFILE_BEGIN + size].decode("utf-8", "replace")
    if profile == "ros2" or size > len(head):
        return
    if profile == "ros1":
        problem = "is an MCAP file of ROS 1 messages, expected those of ROS 2"
        remedy = "give the ROS 1 bag (.bag) that it was made of, or the joint states as CSV, as "
        remedy += "PlotJuggler exports them"
    else:
        problem = f'is an MCAP file with the profile "{profile}", expected messages of ROS 2; its '
        problem += "own (such as JSON or protobuf) are not read"
        remedy = "export the joint states as CSV (as PlotJuggler does), or as JSON, one object a "
        remedy += "line (.jsonl)"
    raise InputError(path, "", problem, remedy)


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

    return _decompressed(ZstdDecompressor(), data, size)


def _lz4(data: bytes, size: int = LARGEST_PART) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    return _decompressed(LZ4FrameDecompressor(), data, size)


def _bz2(data: bytes) -> bytes:
    from bz2 import BZ2Decompressor

    return _decompressed(BZ2Decompressor(), data, LARGEST_PART)


def _decompressed(decompressor: Any, data: bytes, size: int) -> bytes:
    """The content of data, of which no more than `size` bytes are made."""
    _refuse_part(size)
    content = bytes(decompressor.decompress(data, max_length=size + 1))
    _refuse_part(len(content))
    return content


def _refuse_part(size: int) -> None:
    if size > LARGEST_PART:
        raise ValueError(f"a chunk of {size} bytes, at most {LARGEST_PART} are read")
