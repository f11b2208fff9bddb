"""Sources of live samples: their protocol, their addresses and the registry by scheme."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol
from urllib.parse import parse_qsl, unquote, urlsplit

from wrenchsight.models.files.input_error import InputError, one_line
from wrenchsight.models.live.samples import Sample, StreamEvent
from wrenchsight.models.robot.robot import Robot

LONGEST_URL = 4096
MOST_ITEMS = 1 << 12  # of one `read`: bounds what is held
RETRY_TIME = 0.25  # s between two tries to connect


class Source(Protocol):
    """A robot, or its stand-in, that sends samples. Nothing is ever written to it.

    Attributes:
        step: s between samples, where the source knows it; None: it is measured.
        rate: seconds of the source's clock in one of this computer's; 0: no relation, samples come
            as fast as they are read.
    """

    @property
    def step(self) -> float | None: ...

    @property
    def rate(self) -> float: ...

    def read(self, timeout: float) -> list[Sample | StreamEvent]:
        """Samples and events since the last call, in order; MOST_ITEMS at most.

        Every fault is an event, never an exception. Nothing follows EventKind.ENDED.

        Args:
            timeout: s, longest wait for the next one.
        """
        ...

    def close(self) -> None:
        """Ends it; more than once does no harm."""
        ...


@dataclass(frozen=True)
class SourceAddress:
    """A source's URL: SCHEME://PLACE[?KEY=VALUE&...].

    Attributes:
        scheme: which kind of source.
        place: a host with its port, a file, or a channel.
        options: the keys after `?`.
    """

    scheme: str
    place: str
    options: dict[str, str]

    @classmethod
    def parse(cls, url: str) -> "SourceAddress":
        """Reads a URL.

        Raises:
            InputError: it is none, or too long.
        """
        scheme, mark, address = url.partition("://")
        if not mark or not scheme or len(url) > LONGEST_URL or not url.isprintable():
            problem = "is no source, expected SCHEME://PLACE"
            raise InputError(one_line(url[:200]), "", problem, f"give one of {_schemes()}")
        place, _, query = address.partition("?")
        options = dict(parse_qsl(query, keep_blank_values=True, max_num_fields=32))
        return cls(scheme.lower(), place, options)

    def host(self, port: int) -> tuple[str, int]:
        """Host and port of the place; `port` where it states none.

        Raises:
            InputError: it names no host, or a port that is none.
        """
        try:
            parts = urlsplit(f"//{self.place}")
            host, stated_port = parts.hostname, parts.port
            if host:
                host = unquote(host)
                host.encode("idna")  # refuses an empty label, or one of 64 letters and more
        except ValueError:  # UnicodeError among them
            host, stated_port = None, None
        if not host or len(host) > 255 or parts.path not in ("", "/"):
            problem = f'"{self.place}" is no host, expected HOST[:PORT]'
            raise InputError(f"{self.scheme}://", "", problem, "such as 192.168.1.10")
        return host, port if stated_port is None else stated_port

    def number(self, key: str, default: float, least: float, most: float) -> float:
        """An option that is a number.

        Raises:
            InputError: it is none, or out of range.
        """
        text = self.options.get(key)
        if text is None:
            return default
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not least <= value <= most:
            problem = f"is {text}, expected a number of {least:g} to {most:g}"
            raise InputError(f"{self.scheme}://", key, problem, f"{default:g} is the default")
        return value

    def choice(self, key: str, choices: tuple[str, ...]) -> str:
        """An option that is one of several words, the first of which is the default.

        Raises:
            InputError: it is none of them.
        """
        value = self.options.get(key, choices[0])
        if value not in choices:
            problem = f'is "{value}", expected {" or ".join(choices)}'
            raise InputError(f"{self.scheme}://", key, problem)
        return value

    def wants_external_torque(self) -> bool:
        """Whether effort is to be a robot's external torque, by the option `torque`.

        Without it, and where it is `measured`, effort is the joint torque.

        Raises:
            InputError: it is neither `measured` nor `external`.
        """
        return self.choice("torque", ("measured", "external")) == "external"

    def require_known(self, *known: str) -> None:
        """Refuses options that the source does not have.

        Raises:
            InputError: there is one.
        """
        for key in self.options:
            if key not in known:
                remedy = f"it knows {', '.join(known)}" if known else "leave it out"
                raise InputError(f"{self.scheme}://", key, "is no option of this source", remedy)


SourceOpener = Callable[[SourceAddress, Robot], Source]

SOURCES: dict[str, SourceOpener] = {}
"""By scheme, what opens a source. A further kind is one line in
`wrenchsight.analyses.methods.watch.sources`, or one here in a program of one's own."""


def open_source(url: str, robot: Robot) -> Source:
    """Opens a source; a robot that does not answer yet is an event of its `read`.

    Raises:
        InputError: no such kind of source, an option that it does not have, or a file that is
            missing or wrong.
    """
    address = SourceAddress.parse(url)
    opener = SOURCES.get(address.scheme)
    if opener is None:
        problem = f'no source is called "{address.scheme}"'
        raise InputError(url, "", problem, f"give one of {_schemes()}")
    return opener(address, robot)


def _schemes() -> str:
    return ", ".join(f"{scheme}://" for scheme in SOURCES)
