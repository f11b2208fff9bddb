"""Wrenches as ROS 2 messages in an MCAP file: writer and reader.

- /wrench: geometry_msgs/WrenchStamped, the environment on the robot at E, in axes of W. Its frame
  is E_W: E's origin, W's axes.
- /wrench/covariance: std_msgs/Float64MultiArray, 6 x 6, force first, N and N m; ROS has no stamped
  wrench with a covariance. It bears no stamp and is recorded at the wrench's.
- /tf: pose of E_W in the frame of the base link.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.rosbag.messages import (
    STAMP_END,
    WRENCH,
    Layout,
    Stamps,
    header,
    nanoseconds,
    typestore,
)
from wrenchsight.models.recordings.rosbag.table import BagWriter, RosbagTable
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST

FRAME = "E_W"
TOPIC = "/wrench"
COVARIANCE_TOPIC = "/wrench/covariance"
COVARIANCE = "std_msgs/msg/Float64MultiArray"
TF = "tf2_msgs/msg/TFMessage"


class TopicMessages(NamedTuple):
    """N messages of one topic.

    Attributes:
        topic: its name.
        kind: message type.
        messages: (N, L) bytes.
    """

    topic: str
    kind: str
    messages: NDArray[np.uint8]


class WrenchMessages:
    """Encoder of wrenches as messages of these topics.

    Args:
        base_link: name of the frame W.
        frame: name of the frame of the wrenches.
    """

    def __init__(self, base_link: str, frame: str = FRAME) -> None:
        """Makes the layout of each topic's messages, from a function that builds an example.

        An example has one stamp (ns) and one number in all places that vary from message to
        message. A Layout compares two of them to learn where in their bytes stamp and numbers are;
        it then writes the numbers of others there, in the order in which the message has them,
        without the message classes.
        """
        kinds = typestore().types
        Vector3 = kinds["geometry_msgs/msg/Vector3"]
        Wrench = kinds["geometry_msgs/msg/Wrench"]
        Transform = kinds["geometry_msgs/msg/Transform"]
        TransformStamped = kinds["geometry_msgs/msg/TransformStamped"]
        Dimension = kinds["std_msgs/msg/MultiArrayDimension"]
        no_rotation = kinds["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
        # The stride of a dimension counts the numbers in it: of all rows, and of one.
        rows = Dimension(label="rows", size=6, stride=36)
        columns = Dimension(label="columns", size=6, stride=6)
        matrix = kinds["std_msgs/msg/MultiArrayLayout"](dim=[rows, columns], data_offset=0)

        def wrench_example(stamp: int, number: float) -> Any:
            vector = Vector3(x=number, y=number, z=number)
            wrench = Wrench(force=vector, torque=vector)
            return kinds[WRENCH](header=header(frame, stamp), wrench=wrench)

        def tf_example(stamp: int, number: float) -> Any:
            translation = Vector3(x=number, y=number, z=number)
            transform = Transform(translation=translation, rotation=no_rotation)
            pose = TransformStamped(
                header=header(base_link, stamp), child_frame_id=frame, transform=transform
            )
            return kinds[TF](transforms=[pose])

        def covariance_example(_stamp: int, number: float) -> Any:
            return kinds[COVARIANCE](layout=matrix, data=np.full(36, number))

        self._tf = Layout(TF, tf_example)
        self._wrench = Layout(WRENCH, wrench_example)
        # Its messages bear no stamp.
        self._covariance = Layout(COVARIANCE, covariance_example, stamped=False)

    def encode(
        self, stamps: Stamps, wrench: Array, covariance: Array, p_WE: Array
    ) -> list[TopicMessages]:
        """Returns the N messages of each topic.

        Args:
            stamps: (N,) ns, not negative.
            wrench, covariance, p_WE: as `WrenchBagWriter.write`.
        """
        sigma = covariance[:, FORCE_FIRST][:, :, FORCE_FIRST].reshape(len(stamps), 36)
        force_first = wrench[:, FORCE_FIRST]
        return [
            TopicMessages("/tf", TF, self._tf.encode(stamps, np.asarray(p_WE))),
            TopicMessages(TOPIC, WRENCH, self._wrench.encode(stamps, force_first)),
            TopicMessages(COVARIANCE_TOPIC, COVARIANCE, self._covariance.encode(stamps, sigma)),
        ]


class WrenchBagWriter:
    """Writer of such a file as a stream; it appears when the `with` block ends without error.

    Args:
        path: path of the file, *.mcap.
        base_link: name of the frame W.

    Raises:
        InputError: the file cannot be written, or a time is beyond the range of a stamp.
    """

    def __init__(self, path: str | Path, base_link: str) -> None:
        self.path = Path(path)
        self._base_link = base_link
        self._writer = BagWriter(self.path)

    def __enter__(self) -> "WrenchBagWriter":
        self._writer.__enter__()
        self._messages = WrenchMessages(self._base_link)
        return self

    def write(self, t: Array, wrench: Array, covariance: Array, p_WE: Array) -> None:
        """Appends N wrenches.

        Args:
            t: (N,) s; rounded to the nanosecond that a stamp holds.
            wrench: (N, 6) ROTATION FIRST, as everywhere but in files; so is the next.
            covariance: (N, 6, 6).
            p_WE: (N, 3) m.

        Raises:
            InputError: a time that a stamp cannot hold.
        """
        stamps = nanoseconds(np.asarray(t, float))
        if len(stamps) and not 0 <= stamps.min() <= stamps.max() < STAMP_END * 10**9:
            raise InputError(
                self.path, "", "a stamp of ROS holds 0 to 2^31 s", "shift the log's times"
            )
        for topic, kind, messages in self._messages.encode(stamps, wrench, covariance, p_WE):
            self._writer.write(topic, kind, stamps, messages)

    def __exit__(self, kind: Any, error: BaseException | None, traceback: Any) -> None:
        self._writer.__exit__(kind, error, traceback)


def read_wrench_bag(path: str | Path, topic: str = TOPIC) -> tuple[Array, Array]:
    """Reads the times (N,) in s and the wrenches (N, 6), ROTATION FIRST, of a bag.

    Raises:
        InputError: no such bag, a damaged one, or one without this topic.
    """
    about_to_read(path)
    table = RosbagTable(Path(path))
    assert table.names is not None
    names = [name for name in table.names if name.startswith(topic + "/")]
    if len(names) != 6:
        raise InputError(path, topic, "is no topic of wrenches in this bag", "name another topic")
    columns = [0, *(table.names.index(name) for name in names)]
    values = np.concatenate([block for block, _ in table.blocks(columns)])
    return values[:, 0], values[:, [4, 5, 6, 1, 2, 3]]
