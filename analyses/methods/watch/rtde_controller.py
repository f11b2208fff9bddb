"""RTDE controller: plays a log, or a simulated arm, to whoever connects.

It stands in for a robot: `simulate --publish rtde://HOST` and the tests use it. It listens on this
computer alone unless HOST is another of its addresses, and takes no input.
"""

import socket
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.live.rtde import (
    FIELD_TYPES,
    NOT_FOUND,
    ROBOT_RUNS,
    RTDE_PORT,
    RTDE_VERSION,
    PacketReader,
    PacketType,
    ProtocolError,
    Recipe,
    packet,
    read_outputs_request,
)
from wrenchsight.models.live.samples import CONTROLLER_SIGNALS
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording

LOOPBACK = "127.0.0.1"
MOST_CLIENTS = 8
LONGEST_WAIT = 0.1  # s, also over a gap of the recording
LONGEST_SEND = 0.5  # s; a client that takes nothing for so long is left
_SOFTWARE_VERSION = (5, 11, 0, 0)
_SIZES = {"DOUBLE": 1, "INT32": 1, "VECTOR6D": 6}

Tamper = Callable[[int, bytes], Sequence[bytes]]


class RtdeController:
    """Plays successive parts of a recording by their own times; once, from the first client on.

        with RtdeController([recording], port=0) as controller:
            source = open_source(f"rtde://127.0.0.1:{controller.port}", robot)

    Args:
        parts: parts of one recording of six joints.
        host, port: to listen on; port 0: a free one.
        rate: seconds of the recording in one of this computer's; 0: as fast as clients take it.
        tamper: takes number and bytes of each data packet and returns what is sent in its place;
            for tests. Its ConnectionError ends the connection.

    Attributes:
        port: that it listens on.
        robot_mode, safety_mode, payload: as it states them; kg.
        ended: set once the recording is over.

    Raises:
        InputError: the port is taken, or may not be used.
    """

    def __init__(
        self,
        parts: Iterable[Recording],
        host: str = LOOPBACK,
        port: int = RTDE_PORT,
        rate: float = 1.0,
        tamper: Tamper | None = None,
    ) -> None:
        # A thread accepts clients, one each answers them, another plays to all that have asked.
        # They start last: they use all that is set here.
        self.robot_mode, self.safety_mode, self.payload = ROBOT_RUNS, 1, 0.0  # 1: normal
        self._parts, self._rate, self._tamper = parts, rate, tamper
        self._clients: list[_Client] = []
        self._lock = threading.Lock()  # of the list of clients
        # Set when a client has asked for data, when `close` was called, when all is played.
        self._started, self._closing = threading.Event(), threading.Event()
        self.ended = threading.Event()
        try:
            self._listener = socket.create_server((host, port), backlog=MOST_CLIENTS)
        except OSError as error:
            reason = error.strerror or str(error)
            raise InputError(f"{host}:{port}", "", f"cannot be listened on ({reason})") from None
        self.port: int = self._listener.getsockname()[1]
        self._iterator = iter(parts)  # of the parts after the first
        self._first = next(self._iterator)
        self._names = set(_signals(self._first))  # of RTDE's fields that can be sent
        self._slack = 0.5 * self._first.time_step  # s, by which a row may be early
        self._threads = [
            threading.Thread(target=work, daemon=True) for work in (self._accept, self._play)
        ]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> "RtdeController":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends all connections."""
        self._closing.set()
        self._started.set()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.drop_clients()
        for thread in self._threads:
            thread.join(2.0)

    def drop_clients(self) -> None:
        """Ends the connections that there are, as a cable that is pulled and put in again."""
        with self._lock:
            for client in self._clients:
                client.close()
            self._clients.clear()

    def _accept(self) -> None:
        while not self._closing.is_set():
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection: socket.socket) -> None:
        client = _Client(connection)
        with self._lock:
            if len(self._clients) >= MOST_CLIENTS or self._closing.is_set():
                client.close()
                return
            self._clients.append(client)
        packets = PacketReader()
        with suppress(OSError, ProtocolError):
            while data := connection.recv(4096):
                for kind, payload in packets.feed(data):
                    self._answer(client, kind, payload)
        client.close()
        with self._lock, suppress(ValueError):
            self._clients.remove(client)

    def _answer(self, client: "_Client", kind: PacketType, payload: bytes) -> None:
        yes = b"\x01"
        if kind is PacketType.PROTOCOL_VERSION:
            agreed = payload == RTDE_VERSION.to_bytes(2, "big")
            client.send(packet(kind, yes if agreed else b"\x00"))
        elif kind is PacketType.CONTROL_VERSION:
            client.send(packet(kind, b"".join(n.to_bytes(4, "big") for n in _SOFTWARE_VERSION)))
        elif kind is PacketType.OUTPUTS:
            frequency, names = read_outputs_request(payload)
            types = [FIELD_TYPES[n] if n in self._names else NOT_FOUND for n in names]
            client.recipe = Recipe(1, tuple(names), tuple(types))
            client.period = 1.0 / frequency if frequency > 0.0 else 0.0
            client.send(client.recipe.answer())
        elif kind is PacketType.START:
            ready = client.recipe is not None and not client.recipe.missing
            client.send(packet(kind, yes if ready else b"\x00"))
            client.started = ready
            if ready:
                self._started.set()
        elif kind is PacketType.PAUSE:
            client.started = False
            client.send(packet(kind, yes))

    def _play(self) -> None:
        self._started.wait()
        begin: float | None = None
        count = 0
        part: Recording | None = self._first
        while part is not None and not self._closing.is_set():
            signals = _signals(part)
            rows = {name: signal.reshape(len(part.t), -1) for name, signal in signals.items()}
            for k, t in enumerate(part.t.tolist()):
                now = time.monotonic()
                begin = now - t / self._rate if begin is None and self._rate else begin
                while begin is not None and not self._closing.is_set():
                    wait = begin + t / self._rate - time.monotonic()
                    if wait <= 0.0:
                        break
                    time.sleep(min(wait, LONGEST_WAIT))
                if self._closing.is_set():
                    return
                self._send(rows, k, t, count)
                count += 1
            part = next(self._iterator, None)
        self.ended.set()

    def _send(self, rows: dict[str, Array], k: int, t: float, count: int) -> None:
        with self._lock:
            clients = [client for client in self._clients if client.started]
        for client in clients:
            if not client.is_due(t, self._slack):
                continue
            assert client.recipe is not None
            values: list[float] = []
            for name in client.recipe.names:
                values += self._now(name, rows, k)
            data = client.recipe.encode(values)
            try:
                for part in (data,) if self._tamper is None else self._tamper(count, data):
                    client.send(part)
            except OSError:
                client.close()

    def _now(self, name: str, rows: dict[str, Array], k: int) -> list[float] | list[int]:
        if name in ("robot_mode", "safety_mode"):
            logged = rows[name][k, 0]
            if np.isfinite(logged):
                return [int(logged)]
            return [self.robot_mode if name == "robot_mode" else self.safety_mode]
        if name == "payload":
            return [self.payload]
        values: list[float] = rows[name][k].tolist()
        return values


class _Client:
    """One connection."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(  # sends alone may time out: the client need not send anything
            socket.SOL_SOCKET,
            socket.SO_SNDTIMEO,
            int(LONGEST_SEND).to_bytes(8, "little")
            + int(1e6 * (LONGEST_SEND % 1.0)).to_bytes(8, "little"),
        )
        self.recipe: Recipe | None = None
        self.period = 0.0
        self.started = False
        self._due = -np.inf

    def is_due(self, t: float, slack: float) -> bool:
        """Whether it gets the row of time t s, at the frequency that it asked for."""
        if t < self._due - slack:
            return False
        due = self._due + self.period
        self._due = due if due > t - slack else t + self.period  # anew after a gap, and at first
        return True

    def send(self, data: bytes) -> None:
        """Sends all of it.

        Raises:
            OSError: the client does not take it.
        """
        self._connection.sendall(data)

    def close(self) -> None:
        """Ends it."""
        self.started = False
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        self._connection.close()


def _signals(part: Recording) -> dict[str, Array]:
    """Signals of a part, by their names in the protocol."""
    unknown = np.full(len(part.t), np.nan)
    signals: dict[str, Array] = {
        "timestamp": part.t,
        "actual_q": part.q,
        "actual_qd": part.v,
        "actual_current": part.current,
        "robot_mode": unknown,
        "safety_mode": unknown,
        "payload": unknown,
    }
    if part.tau_J is not None:
        signals["actual_current_as_torque"] = part.tau_J
    for extra_name, signal in part.extra.items():
        name = CONTROLLER_SIGNALS.get(extra_name, extra_name)
        size = _SIZES.get(FIELD_TYPES.get(name, ""))
        if size is not None and signal.size == size * len(part.t):
            signals[name] = signal
    return signals
