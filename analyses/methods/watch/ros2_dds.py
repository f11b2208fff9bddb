"""Topics of ROS 2 by DDS, without ROS: its types, its names, and messages as bytes (CDR).

A topic NAME is `rt/NAME` in DDS, and a type `sensor_msgs/msg/JointState`
`sensor_msgs::msg::dds_::JointState_`. The types are made from the definitions that rosbags has;
rosbags also reads and writes the bytes, as those of a bag.

What is opened keeps to this computer's loopback unless an address states otherwise (`network`), or
the environment does (CYCLONEDDS_URI).
"""

import os
import re
from dataclasses import dataclass
from functools import cache
from types import new_class
from typing import Any

from cyclonedds.core import (
    DDSException,
    InstanceState,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl import types as idl
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.live.source import SourceAddress
from wrenchsight.models.recordings.rosbag.messages import typestore

OPTIONS = ("domain", "network")
LARGEST_DOMAIN = 232
LOOPBACK = "lo"
_KEPT_TO_SEND, _KEPT_TO_READ = 10, 4096  # messages
_NAME = re.compile(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
_LONGEST_NAME = 200
_INTERFACE = re.compile(r"[\w.:-]{1,64}", re.ASCII)
_CONFIG = """<CycloneDDS><Domain><General><Interfaces><NetworkInterface {interface}/></Interfaces>
{multicast}</General><Internal><MaxSampleSize>1 MiB</MaxSampleSize></Internal>{peers}</Domain>
</CycloneDDS>"""
_HERE = """<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>99
</MaxAutoParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>"""
_domains: dict[int, tuple[str, Domain]] = {}  # as DDS: one configuration a process and domain


class Raw:
    """A message that was received.

    Attributes:
        data: its bytes.
        sample_info: its state in DDS.
    """

    sample_info: Any = None

    def __init__(self, data: bytes) -> None:
        self.data = data


@cache
def dds_type(kind: str) -> Any:
    """The type of DDS of a message, such as `sensor_msgs/msg/JointState`."""
    package, middle, name = kind.split("/")
    fields = {field: _dds_field(node) for field, node in typestore().fielddefs[kind][1]}

    def fill(namespace: dict[str, Any]) -> None:
        namespace["__annotations__"].update(fields)
        # numpy and rosbags read a hundred times faster than the type itself would
        namespace["deserialize"] = classmethod(lambda cls, data, *_, **__: Raw(bytes(data)))

    typename = {"typename": f"{package}::{middle}::dds_::{name}_"}
    return dataclass(new_class(name, (IdlStruct,), typename, fill))


def _dds_field(node: Any) -> Any:
    """The type of a field, as rosbags notes it: (1, base), (2, message) or (4, sequence)."""
    kind, argument = int(node[0]), node[1]
    if kind == 2:
        return dds_type(argument)
    if kind == 4:
        return idl.sequence[_dds_field(argument[0])]
    assert kind == 1, f"no array is needed, found {node}"
    return str if argument[0] == "string" else getattr(idl, argument[0])


def topic_name(address: SourceAddress) -> str:
    """The topic of an address, without the slash before it.

    Raises:
        InputError: it is none.
    """
    name = address.place.strip("/")
    if not _NAME.fullmatch(name) or len(name) > _LONGEST_NAME:
        problem = f'"{address.place}" is no topic of ROS 2'
        raise InputError("ros2://", "", problem, "such as ros2://joint_states")
    return name


def join(address: SourceAddress) -> Any:
    """Joins the domain that an address asks for, as a participant.

    The domain is that of the address, else of ROS_DOMAIN_ID, else 0; the network is this computer
    alone unless the address names an interface. A process opens a domain once, with one
    configuration: ours, or, where the address names no network and the user has configured DDS
    himself, his, which `_domains` does not hold.

    Raises:
        InputError: a domain or a network that is none, or that DDS cannot open.
    """
    by_environment = os.environ.get("ROS_DOMAIN_ID", "0")
    stated = int(by_environment) if by_environment.isdecimal() else 0
    domain = int(address.number("domain", stated, 0, LARGEST_DOMAIN))
    network = address.options.get("network", LOOPBACK)
    if not _INTERFACE.fullmatch(network):
        problem = f'is "{network}", expected an interface such as eth0, or any'
        raise InputError("ros2://", "network", problem)
    is_local = network == LOOPBACK
    interface = 'autodetermine="true"' if network == "any" else f'name="{network}"'
    multicast = "<AllowMulticast>false</AllowMulticast>" if is_local else ""
    peers = _HERE if is_local else ""
    config = _CONFIG.format(interface=interface, multicast=multicast, peers=peers)
    opened_config, _ = _domains.get(domain, (None, None))
    try:
        is_ours = "network" in address.options or not _is_configured()
        if opened_config is None and is_ours:
            _domains[domain] = config, Domain(domain, config)
        elif opened_config not in (None, config):
            problem = f"domain {domain} is open on another network already"
            raise InputError("ros2://", "network", problem, "give one network for a domain")
        return DomainParticipant(domain)
    except DDSException as error:
        raise InputError("ros2://", "", f"DDS cannot be opened on {network} ({error})") from None


def _is_configured() -> bool:
    return bool(os.environ.get("CYCLONEDDS_URI"))


class TopicWriter:
    """Sends messages of one topic; it never waits.

    A subscriber that falls behind by more than a few messages loses them.

    Args:
        participant: participant of the domain.
        name: name of the topic.
        kind: kind of its messages.
    """

    def __init__(self, participant: Any, name: str, kind: str) -> None:
        qos = Qos(
            Policy.Reliability.Reliable(duration(seconds=0)),
            Policy.History.KeepLast(_KEPT_TO_SEND),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        self._type = dds_type(kind)
        topic = Topic(participant, f"rt/{name}", self._type, qos=qos)
        self._writer = DataWriter(participant, topic, qos=qos)

    def write(self, data: bytes) -> bool:
        """Sends a message; whether it could be sent."""
        message = object.__new__(self._type)
        message.serialize = lambda **_: data
        try:
            self._writer.write(message)
        except DDSException:
            return False
        return True

    @property
    def is_read(self) -> bool:
        """Whether somebody reads it."""
        return bool(self._writer.get_matched_subscriptions())


class TopicReader:
    """Reads the messages of one topic, of reliable publishers and of others.

    Args:
        participant, name, kind: as `TopicWriter`.
    """

    def __init__(self, participant: Any, name: str, kind: str) -> None:
        qos = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(_KEPT_TO_READ))
        topic = Topic(participant, f"rt/{name}", dds_type(kind))
        self._reader = DataReader(participant, topic, qos=qos)
        any_state = ViewState.Any | InstanceState.Any | SampleState.NotRead
        self._condition = ReadCondition(self._reader, any_state)
        self._set = WaitSet(participant)
        self._set.attach(self._condition)

    def take(self, timeout: float) -> list[bytes | None]:
        """The messages that came, the oldest first; None: the last publisher went.

        Args:
            timeout: s, longest wait where there is none.

        Raises:
            DDSException: DDS failed.
        """
        if not self._condition.triggered:
            self._set.wait(duration(nanoseconds=max(0, round(1e9 * timeout))))
        messages = self._reader.take(_KEPT_TO_READ)
        samples = [message.data for message in messages if message.sample_info.valid_data]
        # A sample that is read after its publisher left carries that state itself.
        if messages and messages[-1].sample_info.instance_state != InstanceState.Alive:
            samples.append(None)
        return samples
