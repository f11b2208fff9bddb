"""Gets published recordings into the user's cache; only whole, checked files count.

A partly received file stays in the folder as `.NAME.part`, and the next attempt requests the
remainder. A file gets its name when its SHA-256 is the known one. Two processes that get the same
set take turns.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final
from urllib.parse import unquote, urlsplit

import filelock

from wrenchsight.analyses.data_sets.conversion import CONVERSIONS
from wrenchsight.analyses.data_sets.places import CACHE_VARIABLE, cache_folder, is_whole
from wrenchsight.analyses.data_sets.registry import DATA_SETS, DataSet, PublishedFile, data_set
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file

if TYPE_CHECKING:
    import requests

PUBLIC_HOST: Final = "https://raw.githubusercontent.com"
MIRROR_VARIABLE: Final = "WRENCHSIGHT_DATA_MIRROR"
_REQUEST_TIMEOUTS: Final = (10.0, 30.0)  # s to connect, and between two pieces
_PIECE_BYTES: Final = 1 << 12  # bytes; a cut connection loses the last, incomplete one
_MAX_RETRIES: Final = 1


@dataclass(frozen=True)
class Fetched:
    """Outcome of fetching one requested set."""

    name: str
    folder: Path
    num_files: int  # received now and whole; 0 if all were present
    problem: str = ""  # why the set is not whole


def fetchable() -> tuple[str, ...]:
    """The sets that can be fetched."""
    return tuple(name for name, data_set in DATA_SETS.items() if data_set.published)


def mirror_url(mirror: str | None) -> str:
    """The host of the files: the mirror, else that of the environment, else the public one.

    Raises:
        InputError: not an address of the kinds http, https or file.
    """
    url = mirror or os.environ.get(MIRROR_VARIABLE, "") or PUBLIC_HOST
    source = "--mirror" if mirror else MIRROR_VARIABLE
    parts = urlsplit(url)
    is_file = parts.scheme == "file" and not parts.netloc and parts.path.startswith("/")
    if not is_file and not (parts.scheme in ("http", "https") and parts.netloc):
        problem = f"is {url!r}, expected an address such as https://host/path or file:///folder"
        raise InputError(source, "", problem)
    return url.rstrip("/")


def fetch_data_sets(
    names: Sequence[str],
    mirror: str | None = None,
    progress: Callable[[str, float, str], None] = lambda name, share, action: None,
) -> tuple[Fetched, ...]:
    """Gets sets into the cache; one that fails does not stop the others.

    Args:
        names: names of sets; none means all that can be fetched.
        mirror: address below which files lie as on the public host,
            `<repository>/<commit>/<path>`; None: `mirror_url`'s.
        progress: takes the set, the share of it that is present, and the present action.

    Raises:
        InputError: an unknown set, one that cannot be fetched, a wrong address, or a cache that
            cannot be written.
    """
    sets = [data_set(name) for name in dict.fromkeys(names or fetchable())]
    for requested in sets:
        if not requested.published:
            raise InputError(requested.name, "", "cannot be fetched", requested.advice)
    url = mirror_url(mirror)
    return tuple(_fetch_set(requested, url, progress) for requested in sets)


def _fetch_set(data_set: DataSet, url: str, progress: Callable[[str, float, str], None]) -> Fetched:
    """Fetches the published files of a set that are not whole in the cache, and converts them.

    The files of a set are those that are published and those that are made of them.

    Args:
        url: of the host.
        progress: takes name, share of the bytes and step; the step is empty when it is done.

    Returns:
        What was fetched; with a problem in words where a file cannot be: then it ends, and what was
        fetched before is kept.

    Raises:
        InputError: the cache cannot be written.
    """
    folder = cache_folder() / data_set.name
    if all(is_whole(folder / file.name, file) for file in data_set.files):
        progress(data_set.name, 1.0, "")
        return Fetched(data_set.name, folder, num_files=0)
    with _writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with _one_process(
        folder, lambda: progress(data_set.name, 0.0, "waiting: another process fetches it")
    ):
        for stray in folder.glob("tmp*"):  # of a process that was killed while pooch checked
            stray.unlink()
        missing = [file for file in data_set.published if not is_whole(folder / file.name, file)]
        done = sum(file.num_bytes for file in data_set.published if file not in missing)  # bytes
        total = sum(file.num_bytes for file in data_set.published)
        for num_fetched, file in enumerate(missing):
            progress(data_set.name, done / total, file.name)

            # Bytes of this file; file and done as they are in this turn of the loop.
            def report(count: int, file: PublishedFile = file, done: int = done) -> None:
                progress(data_set.name, (done + min(count, file.num_bytes)) / total, file.name)

            problem = _fetch_file(file, folder, url, report)
            if problem:
                return Fetched(data_set.name, folder, num_fetched, problem)
            done += file.num_bytes
        _convert(data_set, folder)
    progress(data_set.name, 1.0, "")
    return Fetched(data_set.name, folder, num_files=len(missing))


def _fetch_file(file: PublishedFile, folder: Path, url: str, report: Callable[[int], None]) -> str:
    """Gets a file, with one retry; returns what went wrong, or nothing.

    Args:
        url: of the host.
        report: called with the number of bytes received so far.

    Raises:
        InputError: the folder cannot be written.
    """
    import pooch
    import requests

    # pooch checks the SHA-256, and tries again where it differs or the connection fails.
    address = f"{url}/{file.address}"
    source = pooch.create(
        path=folder,
        base_url="",
        registry={file.name: f"sha256:{file.sha256}"},
        urls={file.name: address},
        retry_if_failed=_MAX_RETRIES,
    )
    pooch.get_logger().setLevel("ERROR")
    try:
        with _writing(folder):  # passes on RequestException, which is an OSError, too
            source.fetch(file.name, downloader=_Resuming(file, folder, report))
    except requests.RequestException as error:
        reason = _reason(error)
        if urlsplit(url).scheme == "file":
            reason = f"cannot be read ({_deepest_words(error)})"
        return f"{address}: {reason}"
    except ValueError as error:
        if isinstance(error, InputError):  # of `_writing`; it is a ValueError, too
            raise
        # What pooch raises where the SHA-256 differs.
        return f"{address}: is not the published file (its SHA-256 differs)"
    return ""


class _Resuming:
    """A downloader for pooch that continues where an earlier attempt was cut."""

    def __init__(self, file: PublishedFile, folder: Path, report: Callable[[int], None]) -> None:
        self._file, self._report = file, report
        self._part = folder / f".{file.name}.part"

    def __call__(
        self, url: str, output_file: str | IO[bytes], pooch: Any, check_only: bool = False
    ) -> None:
        """Downloads an address into a file, which pooch then checks.

        The bytes gather in a part beside it, which outlives a cut connection, and this process.
        The arguments are those with which pooch calls a downloader: `output_file` is a path here,
        `pooch` and `check_only` are not used.

        Raises:
            requests.RequestException: the file did not come to its end.
            OSError: it cannot be written.
        """
        import requests

        size = self._file.num_bytes
        received = self._part.stat().st_size if self._part.is_file() else 0
        if received < size:
            # After a cut connection, the part holds what was received.
            with self._part.open("ab") as part, suppress(requests.exceptions.ChunkedEncodingError):
                for count in _pieces(url, part, received):
                    self._report(count)
                    if count > size:  # not the published file: pooch is to find that
                        break
            received = self._part.stat().st_size
        if received < size:
            raise requests.ConnectionError(f"ended after {received} of {size} bytes")
        # Whole, or not the file: in either case the next attempt begins anew.
        self._part.replace(str(output_file))


def _pieces(url: str, part: IO[bytes], received: int) -> Iterator[int]:
    """Appends an address's content to a part of `received` bytes; yields the part's size.

    Where the host does not go on from there, the part is emptied first.

    Raises:
        requests.RequestException: the connection fails, or is cut.
    """
    parts = urlsplit(url)
    if parts.scheme == "file":
        yield from _copied(Path(unquote(parts.path)), part, received)
        return
    import requests

    # Not compressed: a range would count compressed bytes.
    headers = {"Accept-Encoding": "identity"} | (
        {"Range": f"bytes={received}-"} if received else {}
    )
    with requests.get(url, headers=headers, stream=True, timeout=_REQUEST_TIMEOUTS) as response:
        if response.status_code == requests.codes.requested_range_not_satisfiable:
            part.truncate(0)
            raise requests.ConnectionError(
                "the host's file is shorter than the part received earlier"
            )
        response.raise_for_status()
        if received and not _continues(response, received):
            part.truncate(0)
            received = 0
        for piece in response.iter_content(_PIECE_BYTES):
            part.write(piece)
            received += len(piece)
            yield received


def _continues(response: "requests.Response", received: int) -> bool:
    """Whether a host sends the remainder after `received` bytes, as requested."""
    content_range = response.headers.get("Content-Range", "")
    return response.status_code == 206 and content_range.startswith(f"bytes {received}-")


def _copied(path: Path, part: IO[bytes], received: int) -> Iterator[int]:
    import requests

    try:
        with path.open("rb") as source:
            source.seek(received)
            while piece := source.read(_PIECE_BYTES):
                part.write(piece)
                received += len(piece)
                yield received
    except OSError as error:
        if error.filename != str(path):
            raise
        raise requests.ConnectionError(error.strerror or str(error)) from error


def _reason(error: "requests.RequestException") -> str:
    """The reason of an error, in a few words."""
    import requests

    if isinstance(error, requests.HTTPError) and error.response is not None:
        return f"the host answers {error.response.status_code} {error.response.reason}"
    if isinstance(error, requests.Timeout):
        return "the host does not answer in time"
    return f"the connection failed ({_deepest_words(error)})"


def _deepest_words(error: "requests.RequestException") -> str:
    """What the innermost cause of an error says."""
    cause = error.args[0] if error.args else error
    deepest = getattr(cause, "reason", None) or cause
    words = str(deepest).rpartition(": ")[2] or type(error).__name__
    return words.strip(" )")


def _convert(data_set: DataSet, folder: Path) -> None:
    """Makes the files that an experiment reads from the published ones."""
    if all(is_whole(folder / file.name, file) for file in data_set.converted):
        return
    for name, text in CONVERSIONS[data_set.name](folder).items():
        with whole_file(folder / name) as path:
            path.write_text(text, encoding="utf-8")


@contextmanager
def _one_process(folder: Path, waiting: Callable[[], None]) -> Iterator[None]:
    """Within, no other process gets the same set."""
    lock = filelock.FileLock(folder.parent / f".{folder.name}.lock")
    with _writing(folder):
        try:
            lock.acquire(blocking=False)
        except filelock.Timeout:
            waiting()
            lock.acquire()
    try:
        yield
    finally:
        lock.release()


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    """Turns an error of the cache's file system into an InputError."""
    import requests

    try:
        yield
    except requests.RequestException:  # an OSError, too
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        remedy = f"free space there, or name another folder in {CACHE_VARIABLE}"
        raise InputError(folder, "", f"cannot be written ({reason})", remedy) from error
