"""Where the reading process sends each reading at once: `udp://`, `lcm://`, `ros2://`.

Sending never waits: what the network does not take is lost, and counted.
"""

import socket
import struct
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from wrenchsight.analyses.methods.watch.links import link
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.source import SourceAddress
from wrenchsight.models.robot.robot import Robot

DATAGRAM = struct.Struct("<4sHHd12d")
"""A UDP packet, little-endian: b"WSR1"; flags (1 valid, 2 contact, 4 misfit, 8 the robot runs); why
it is not valid, the lowest 16 bits of `models.estimation.invalid`; t in s, the controller's; fx fy
fz mx my mz in N and N m at E in axes of W, environment on robot; their standard deviations."""
MAGIC = b"WSR1"
REASON_BITS = 0xFFFF
VALID_FLAG, CONTACT_FLAG, MISFIT_FLAG, RUNNING_FLAG = 1, 2, 4, 8


class Publisher(Protocol):
    """Sends readings. It must not wait, nor raise.

    Attributes:
        lost: readings that could not be sent.
    """

    lost: int

    def send(self, reading: Reading) -> None:
        """Sends one."""
        ...

    def close(self) -> None:
        """Ends it."""
        ...


def datagram(reading: Reading) -> bytes:
    """The UDP packet of a reading."""
    flags = (
        VALID_FLAG * reading.valid + CONTACT_FLAG * reading.contact + MISFIT_FLAG * reading.misfit
    )
    flags += RUNNING_FLAG * reading.running
    invalid = reading.invalid & REASON_BITS
    return DATAGRAM.pack(MAGIC, flags, invalid, reading.t, *reading.force_first.tolist())


class UdpPublisher:
    """One datagram a reading."""

    def __init__(self, address: SourceAddress, robot: Robot) -> None:
        address.require_known()
        host, port = address.host(0)
        if not port:
            raise InputError("udp://", "", "names no port", "such as udp://127.0.0.1:5005")
        try:
            family, kind, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        except OSError as error:
            raise InputError(f"udp://{host}", "", f"is no host ({error.strerror})") from None
        self._place = place
        self._socket = socket.socket(family, kind)
        self._socket.setblocking(False)
        self.lost = 0

    def send(self, reading: Reading) -> None:
        """As the protocol."""
        try:
            self._socket.sendto(datagram(reading), self._place)
        except OSError:
            self.lost += 1

    def close(self) -> None:
        """As the protocol."""
        with suppress(OSError):
            self._socket.close()


PublisherOpener = Callable[[SourceAddress, Robot], Publisher]

PUBLISHERS: dict[str, PublisherOpener] = {
    "udp": UdpPublisher,
    "lcm": link("lcm_links:LcmPublisher.open"),
    "ros2": link("ros2_publisher:Ros2Publisher.open", "ros2"),
}
"""By scheme. A further kind is one line here."""


def open_publisher(url: str, robot: Robot) -> Publisher:
    """Opens a publisher.

    Args:
        url: where to.

    Raises:
        InputError: no such kind, or an address that is none.
    """
    address = SourceAddress.parse(url)
    if address.scheme not in PUBLISHERS:
        known = ", ".join(f"{scheme}://" for scheme in PUBLISHERS)
        raise InputError(url, "", "is no place to publish to", f"give one of {known}")
    return PUBLISHERS[address.scheme](address, robot)
