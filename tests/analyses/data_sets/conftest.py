"""A set of recordings of a test's own, and a host that serves it as the public one does."""

import hashlib
import json
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from wrenchsight.analyses.data_sets import registry
from wrenchsight.analyses.data_sets.places import CACHE_VARIABLE
from wrenchsight.analyses.data_sets.registry import DataSet, PublishedFile

SET = "toy"
CONTENT = {
    "a.csv": b"0.1,0.2\n" * 20_000,
    "b.csv": bytes(range(256)) * 1000,
}
# Fetches the set SET in a process of its own; its files come as JSON, its host as an argument.
PROGRAM = """
import json, sys
from wrenchsight.analyses.data_sets import registry
from wrenchsight.analyses.data_sets.fetching import fetch_data_sets
from wrenchsight.models.files.input_error import InputError

files = tuple(registry.PublishedFile(**one) for one in json.loads(sys.argv[1]))
registry.DATA_SETS["toy"] = registry.DataSet("toy", "r", "w", "MIT", "s", "", 1.0)
registry._published = lambda: {"toy": files}
messages = []
try:
    (result,) = fetch_data_sets(["toy"], sys.argv[2], lambda *step: messages.append(step[2]))
except InputError as error:
    print(error)
    sys.exit(2)
print(result.num_files, result.problem, "waiting" in " ".join(messages))
"""


def published(name: str, content: bytes) -> PublishedFile:
    """A file with this content."""
    return PublishedFile(
        name=name,
        num_bytes=len(content),
        sha256=hashlib.sha256(content).hexdigest(),
        repository="somebody/arm",
        commit="0123abc",
        path=f"data/{name}",
    )


FILES = tuple(published(name, content) for name, content in CONTENT.items())


@dataclass
class Host:
    """A host of files on loopback.

    Attributes:
        content: of the set's files, by name.
        files: content by path.
        ranges: whether it sends the rest of a file when asked.
        cuts: after how many bytes of a body the connection is cut, for the next answers in turn;
            None: not at all.
        requests: (path, Range header) in the order in which they came.
        hold: waited for before a body.
    """

    content: dict[str, bytes]
    files: dict[str, bytes]
    ranges: bool = True
    cuts: list[int | None] = field(default_factory=list)
    requests: list[tuple[str, str | None]] = field(default_factory=list)
    hold: threading.Event = field(default_factory=threading.Event)
    url: str = ""


@pytest.fixture
def host() -> Iterator[Host]:
    """Serves FILES at `<repository>/<commit>/<path>`."""
    served = Host(CONTENT, {f"/{file.address}": CONTENT[file.name] for file in FILES})
    served.hold.set()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            range_header = self.headers.get("Range")
            served.requests.append((self.path, range_header))
            content = served.files.get(self.path)
            if content is None:
                self.send_error(404)
                return
            begin = int(range_header[len("bytes=") : -1]) if range_header and served.ranges else 0
            if begin >= len(content):
                self.send_error(416)
                return
            body = content[begin:]
            self.send_response(206 if begin else 200)
            self.send_header("Content-Length", str(len(body)))
            if begin:
                end = len(content) - 1
                self.send_header("Content-Range", f"bytes {begin}-{end}/{len(content)}")
            self.end_headers()
            cut = served.cuts.pop(0) if served.cuts else None
            self.wfile.write(body[:cut] if cut is not None else body[:1000])
            self.wfile.flush()
            served.hold.wait(60)
            if cut is None:
                self.wfile.write(body[1000:])
            self.close_connection = True

        def log_message(self, *given: object) -> None:
            """Nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    served.url = f"http://127.0.0.1:{server.server_port}"
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield served
    served.hold.set()
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of fetched sets; the set SET is known, and no pause is made before a retry."""
    folder = tmp_path / "cache"
    monkeypatch.setenv(CACHE_VARIABLE, str(folder))
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setattr("time.sleep", lambda seconds: None)
    one = DataSet(SET, "some arm", "nothing", "MIT", "somewhere", "", 1.0)
    monkeypatch.setitem(registry.DATA_SETS, SET, one)
    monkeypatch.setattr(registry, "_published", lambda: {SET: FILES})
    return folder


@pytest.fixture
def fetching_process(cache: Path) -> Callable[..., subprocess.Popen[str]]:
    """Starts a process that fetches SET from an address; it prints what became of it."""

    def start(url: str, *prefix: str) -> subprocess.Popen[str]:
        files = json.dumps([vars(file) for file in FILES])
        command = [*prefix, sys.executable, "-c", PROGRAM, files, url]
        return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)

    return start
