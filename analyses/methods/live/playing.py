"""A recording played at real time to whoever connects, as a controller would speak."""

from collections.abc import Callable

from wrenchsight.analyses.methods.live.rtde_controller import LOOPBACK, RtdeController
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.live.rtde import PORT
from wrenchsight.models.live.source import SourceAddress
from wrenchsight.models.recordings.recording import Recording

_NUM_JOINTS = 6  # of every robot that speaks RTDE


def play(recording: Recording, url: str, tell: Callable[[str], None]) -> None:
    """Plays it once, from the first reader on; returns when it is over.

    Args:
        url: rtde://HOST[:PORT]; only where HOST is no address of this computer's own loopback do
            others see it.
        tell: what a person is to know.

    Raises:
        InputError: another scheme, an arm that cannot speak it, or a port that is taken.
    """
    address = SourceAddress.parse(url)
    address.require_known()
    if address.scheme != "rtde":
        raise InputError("simulate", "--publish", f"cannot speak {address.scheme}", "give rtde://")
    if recording.num_joints != _NUM_JOINTS:
        problem = f"the arm has {recording.num_joints} joints, a controller of RTDE {_NUM_JOINTS}"
        raise InputError("simulate", "--publish", problem)
    host, port = address.host(PORT)
    with RtdeController([recording], host, port) as controller:
        where = f"rtde://{host}:{controller.port}"
        if host not in (LOOPBACK, "localhost", "::1"):
            tell(f"{where} can be reached from other computers")
        tell(f"{recording.duration:.1f} s are played once somebody reads {where}; Ctrl-C ends it")
        while not controller.ended.wait(0.2):
            pass
