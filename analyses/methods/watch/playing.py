"""A recording played at real time to whoever connects, as a controller would speak."""

from collections.abc import Callable

from wrenchsight.analyses.methods.watch.links import link
from wrenchsight.analyses.methods.watch.rtde_controller import LOOPBACK, RtdeController
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.live.rtde import RTDE_PORT
from wrenchsight.models.live.source import SourceAddress
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

_NUM_JOINTS = 6  # of every robot that speaks RTDE


def play(recording: Recording, robot: Robot, url: str, tell: Callable[[str], None]) -> None:
    """Plays it once, from the first reader on; returns when it is over.

    Args:
        url: rtde://HOST[:PORT] or ros2://TOPIC; only where it names an address or a network beyond
            this computer's own loopback do others see it.
        tell: what a person is to know.

    Raises:
        InputError: another scheme, an arm that cannot speak it, or a port that is taken.
    """
    address = SourceAddress.parse(url)
    if address.scheme not in PLAYERS:
        remedy = f"give {' or '.join(f'{scheme}://' for scheme in PLAYERS)}"
        raise InputError("simulate", "--publish", f"cannot speak {address.scheme}", remedy)
    PLAYERS[address.scheme](recording, robot, address, tell)


def _rtde(
    recording: Recording, robot: Robot, address: SourceAddress, tell: Callable[[str], None]
) -> None:
    address.require_known()
    if recording.num_joints != _NUM_JOINTS:
        problem = f"the arm has {recording.num_joints} joints, a controller of RTDE {_NUM_JOINTS}"
        raise InputError("simulate", "--publish", problem)
    host, port = address.host(RTDE_PORT)
    with RtdeController([recording], host, port) as controller:
        where = f"rtde://{host}:{controller.port}"
        if host not in (LOOPBACK, "localhost", "::1"):
            tell(f"{where} can be reached from other computers")
        tell(f"plays {recording.duration:.1f} s once a client reads {where}; Ctrl-C ends it")
        while not controller.ended.wait(0.2):
            pass


Player = Callable[[Recording, Robot, SourceAddress, Callable[[str], None]], None]

PLAYERS: dict[str, Player] = {"rtde": _rtde, "ros2": link("ros2_player:play_joint_states", "ros2")}
"""By scheme. A further kind is one line here."""
