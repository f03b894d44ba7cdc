"""A node of ROS 2 without ROS: publishes and subscribes over DDS, with the names, types and QoS of ROS 2."""

from __future__ import annotations

import functools
import logging
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from cyclonedds._clayer import ddspy_take, ddspy_write
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException, InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl import types as idl
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rosbags.interfaces import Nodetype

from anm_mj.errors import ConfigError, RobotError
from anm_mj.io.ros_messages import RosMessages
from anm_mj.ros.network import domain, domain_id, network_config

_ANY = SampleState.Any | ViewState.Any | InstanceState.Any
_BLOCKING_S = 0.02
"""A reliable publisher waits so long for a slow subscriber [s]."""
_NO_LIMIT = -1
_POLL_S = 0.2
"""The thread of the subscriptions looks so often whether it is to end [s]."""
# Each letter can be read in one way alone: else a wrong name of 40 letters takes days.
_NAME = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
_NUMBERS = ("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64", "float32", "float64")
_BASE = {name: getattr(idl, name) for name in _NUMBERS} | {
    "bool": bool,
    "string": str,
    "byte": idl.uint8,
    "char": idl.uint8,
    "octet": idl.uint8,
}

Heard = Callable[[Any, int], object]
"""Called with a message, and a number that stands for its publisher."""
Parse = Callable[[bytes], Any]
"""Makes a message of what was received."""

_logger = logging.getLogger(__name__)


class DdsTypes:
    """Makes the types of DDS for messages, such as ``sensor_msgs::msg::dds_::Image_``, by the definitions of rosbags.

    The types only tell peers what is sent: messages are serialised by rosbags, because a Python list of numbers for
    each image would cost a hundred times as much.
    """

    def __init__(self, store: Any) -> None:
        self._store = store
        self._made: dict[str, type] = {}

    def of(self, kind: str) -> type:
        """The type of DDS of a message type such as ``sensor_msgs/msg/Image``."""
        if kind not in self._made:
            package, group, leaf = kind.split("/")
            fields = {name: self._field(found) for name, found in self._store.fielddefs[kind][1]}
            self._made[kind] = make_idl_struct(f"{leaf}_", f"{package}.{group}.dds_.{leaf}_", fields)
        return self._made[kind]

    def _field(self, found: Any) -> Any:
        node, of = found
        if node == Nodetype.BASE:
            return _BASE[of[0]]
        if node == Nodetype.NAME:
            return self.of(of)
        inner, count = self._field(of[0]), of[1]
        if node == Nodetype.ARRAY:
            return idl.array[inner, count]
        return idl.sequence[inner, count] if count else idl.sequence[inner]


class Delivery(NamedTuple):
    """The quality of service of a topic."""

    reliable: bool
    latched: bool = False
    """Whether the last messages go to who subscribes later (``transient local``)."""
    depth: int = 10
    """Messages that are kept for a subscriber that is slow, or late."""

    def policies(self) -> Qos:
        """As DDS has it."""
        reliable = Policy.Reliability.Reliable(duration(seconds=_BLOCKING_S))
        history = Policy.History.KeepLast(self.depth)
        policies = [
            reliable if self.reliable else Policy.Reliability.BestEffort,
            Policy.Durability.TransientLocal if self.latched else Policy.Durability.Volatile,
            history,
            Policy.DataRepresentation(use_cdrv0_representation=True),
        ]
        if self.latched:
            # Cyclone DDS keeps one message for late subscribers unless it is told so.
            policies.append(Policy.DurabilityService(0, history, *[_NO_LIMIT] * 3))
        return Qos(*policies)


SENSOR = Delivery(reliable=False, depth=20)
"""Subscriptions to what comes often: publishers of both kinds match."""
STATE = Delivery(reliable=True)
LATCHED = Delivery(reliable=True, latched=True, depth=1)
FRAMES = Delivery(reliable=True, latched=True, depth=100)
"""Several publishers tell of static frames, each of some, and all of them hold."""


class Publisher:
    """Publishes messages on one topic."""

    def __init__(self, writer: Any, messages: RosMessages, topic: str) -> None:
        self._writer, self._messages, self.topic = writer, messages, topic

    def publish(self, message: Any) -> None:
        """Send a message to all subscribers; one that has no room for it does not get it."""
        self.publish_cdr(self._messages.to_cdr(message))

    def publish_cdr(self, cdr: bytes) -> None:
        """Send a message that is serialised already."""
        # DDS counts in words.
        status = ddspy_write(self._writer._ref, cdr.ljust(-(-len(cdr) // 4) * 4, b"\0"))
        # A timeout: a slow reliable subscriber had no room for it.
        if status < 0 and status != DDSException.DDS_RETCODE_TIMEOUT:
            raise RobotError(f"{self.topic} cannot be published ({DDSException(status)}); start the program again.")

    @property
    def num_subscribers(self) -> int:
        """Subscribers that match."""
        return len(self._writer.get_matched_subscriptions())


class Node:
    """Speaks ROS 2; callbacks run in one thread of its own. Close it, or use it in a ``with`` statement."""

    def __init__(self, namespace: str = "", *, on_bad: Callable[[str, str], None] | None = None) -> None:
        """Join the domain of ``ROS_DOMAIN_ID``.

        Args:
            namespace: what relative names are below, such as ``robot1``.
            on_bad: called with the name of a topic, and what is wrong with a message of it; None = that is logged.

        Raises:
            ConfigError: the namespace or the environment's settings of ROS have no meaning.
            RobotError: the network cannot be used.
        """
        self.messages = RosMessages()
        self._types = DdsTypes(self.messages.store)
        self._namespace = require_name(namespace.strip("/")) if namespace.strip("/") else ""
        self._on_bad = on_bad or (lambda topic, what: _logger.warning("%s: %s", topic, what))
        self.on_look: Callable[[], object] = lambda: None
        """Called in the thread of the callbacks after each look for messages, of which there are five a second at
        least."""
        self.number = number = domain_id()
        config = network_config()
        try:
            self._domain = domain(number, config)
            self._participant = DomainParticipant(number)
        except DDSException as err:
            raise RobotError(
                f"Domain {number} of DDS cannot be joined ({err}); check the network, ROS_DOMAIN_ID and CYCLONEDDS_URI."
            ) from err
        self._publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._topics: dict[tuple[str, str], Any] = {}
        self._readers: list[tuple[Any, str, Parse, Heard]] = []
        self._waitset, self._lock = WaitSet(self._participant), threading.Lock()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._spin, name="ros", daemon=True)
        self._thread.start()

    def name(self, topic: str) -> str:
        """The whole name of a topic; one that begins with '/' is whole already. Raises ConfigError if it is no name of
        ROS 2.
        """
        require_name(topic)
        below = f"/{self._namespace}" if self._namespace else ""
        return topic if topic.startswith("/") else f"{below}/{topic}"

    def publisher(self, topic: str, kind: str, delivery: Delivery = STATE) -> Publisher:
        """Publish messages of a type such as ``nav_msgs/msg/Odometry``."""
        return self.raw_publisher(f"rt{self.name(topic)}", kind, delivery)

    def subscribe(self, topic: str, kind: str, heard: Heard, delivery: Delivery = SENSOR) -> None:
        """Call ``heard`` with each message of a topic; ``delivery`` is what is asked of publishers."""
        self.raw_subscribe(f"rt{self.name(topic)}", kind, heard, delivery=delivery)

    def raw_publisher(self, dds_name: str, kind: str, delivery: Delivery = STATE) -> Publisher:
        """Publish on a topic by its name of DDS, such as one of the two of a service."""
        writer = DataWriter(self._participant, self._topic(dds_name, kind), delivery.policies())
        return Publisher(writer, self.messages, dds_name[2:])

    def raw_subscribe(
        self, dds_name: str, kind: str, heard: Heard, parse: Parse | None = None, *, delivery: Delivery = STATE
    ) -> None:
        """Hear a topic by its name of DDS; ``parse`` takes what is not all of its type."""
        reader = DataReader(self._participant, self._topic(dds_name, kind), delivery.policies())
        condition = ReadCondition(reader, ViewState.Any | InstanceState.Any | SampleState.NotRead)
        with self._lock:
            self._waitset.attach(condition)
            self._readers.append((reader, dds_name[2:], parse or functools.partial(self.parse, kind), heard))

    def parse(self, kind: str, cdr: bytes) -> Any:
        """The message of a type that was serialised."""
        return self.messages.store.deserialize_cdr(cdr, kind)

    def published(self) -> dict[str, str]:
        """The topics that anybody publishes, by name, with their types such as ``sensor_msgs/msg/Image``."""
        found = self._publications.read(10_000)
        named = {one.topic_name[2:]: one.type_name for one in found if one.topic_name.startswith("rt/")}
        return {name: kind.replace("::dds_::", "::").replace("::", "/").rstrip("_") for name, kind in named.items()}

    def close(self) -> None:
        """Leave the domain; a second time does nothing."""
        if self._closing.is_set():
            return
        self._closing.set()
        self._thread.join(5.0)
        # Its readers and writers go with it, whoever still holds them.
        self._participant.__del__()

    def __enter__(self) -> Node:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _topic(self, name: str, kind: str) -> Any:
        if (name, kind) not in self._topics:
            self._topics[name, kind] = Topic(self._participant, name, self._types.of(kind))
        return self._topics[name, kind]

    def _spin(self) -> None:
        while not self._closing.is_set():
            self._waitset.wait(duration(seconds=_POLL_S))
            with self._lock:
                readers = list(self._readers)
            for reader, name, parse, heard in readers:
                taken = ddspy_take(reader._ref, _ANY, 100)
                for data, about in taken if isinstance(taken, list) else ():
                    if about.valid_data:
                        with self._going_on(name):
                            heard(parse(data), about.publication_handle)
            with self._going_on("ros"):
                self.on_look()

    @contextmanager
    def _going_on(self, name: str) -> Iterator[None]:
        """Whatever anybody sends, the thread goes on."""
        try:
            yield
        except Exception as err:
            says = isinstance(err, ValueError | RobotError)
            self._on_bad(name, f"{err}".removesuffix(".") if says else f"{type(err).__name__}: {err}")


def require_name(name: str) -> str:
    """The same name; raises ConfigError where ROS 2 has no such names."""
    if not _NAME.fullmatch(name):
        raise ConfigError(
            f"'{name}' is no name of ROS 2; give letters, digits and '_' between slashes, as in camera/depth/image_raw."
        )
    return name
