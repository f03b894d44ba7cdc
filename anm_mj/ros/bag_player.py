"""Publishes a recording again, in the time in which it was made."""

import logging
import math
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from anm_mj.errors import RunFolderError
from anm_mj.io.rosbag import open_bag, unreadable
from anm_mj.ros.node import FRAMES, LATCHED, STATE, Delivery, Node, Publisher

_ALWAYS_LATCHED = {"tf_static": FRAMES, "robot_description": LATCHED}
"""Whatever a recording says of them."""
_TRANSIENT_LOCAL = 1
_LOOK_S = 0.1
"""So often it looks whether to end, also where a recording pauses [s]."""
_AHEAD_S = 1.0
"""Topics are announced so long before their first message [s]: subscribers need time to find them."""

_logger = logging.getLogger(__name__)


def play(
    path: Path,
    node: Node,
    *,
    rate: float = 1.0,
    until: Callable[[], bool] = lambda: False,
    duration_s: float = math.inf,
) -> int:
    """Publish the messages of a ROS 2 bag on their topics, as they were serialised; how many. ``rate`` are recorded
    seconds per second; ``until`` says whether to end before, and ``duration_s`` after how many recorded seconds. Raises
    RunFolderError if it is no bag of ROS 2, or cannot be read.
    """
    count = 0
    with closing(open_bag(path)) as reader:
        if not reader.is2:
            raise RunFolderError(f"{path} is a bag of ROS 1, whose messages ROS 2 does not read; convert it.")
        to = _publishers(reader, node)
        begin = time.monotonic() + _AHEAD_S
        for connection, at_ns, raw in _messages(path, reader, to):
            at_s = 1e-9 * (at_ns - reader.start_time)
            if at_s > duration_s:
                break
            while (wait_s := begin + at_s / rate - time.monotonic()) > 0.0 and not until():
                time.sleep(min(wait_s, _LOOK_S))
            if until():
                break
            to[connection.topic].publish_cdr(bytes(raw))
            count += 1
    return count


def _messages(path: Path, reader: Any, topics: Collection[str]) -> Iterator[tuple[Any, int, bytes]]:
    """The messages of some topics, with their connections and times [ns]. Raises RunFolderError where one cannot be
    read.
    """
    # The package takes no connections for all of them.
    if not topics:
        return
    try:
        yield from reader.messages([one for one in reader.connections if one.topic in topics])
    except Exception as err:
        # Readers raise whatever the damaged bytes lead them to.
        raise unreadable(path, err) from err


def _publishers(reader: Any, node: Node) -> dict[str, Publisher]:
    found: dict[str, Publisher] = {}
    for one in reader.connections:
        if one.msgtype not in node.messages.store.types:
            _logger.warning("%s is left out: its type %s is not known.", one.topic, one.msgtype)
            continue
        found[one.topic] = node.publisher(one.topic, one.msgtype, _delivery(one))
    return found


def _delivery(connection: Any) -> Delivery:
    offered = getattr(connection.ext, "offered_qos_profiles", None) or ()
    latched = any(qos.durability.value == _TRANSIENT_LOCAL for qos in offered)
    return _ALWAYS_LATCHED.get(connection.topic.rpartition("/")[2], LATCHED if latched else STATE)
