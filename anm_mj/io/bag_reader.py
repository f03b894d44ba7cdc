"""Messages of an open bag by topic: the first one, all of them, and when each was made."""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from anm_mj.errors import RunFolderError
from anm_mj.io.sequence import SequenceOptions, require_count


class Stamp(NamedTuple):
    """Where a message lies in time."""

    time_s: float
    """When it was made, as its header has it [s]."""
    at_ns: int
    """When it was recorded [ns]."""


@dataclass(eq=False)
class BagReader:
    """An open bag."""

    path: Path
    reader: Any
    """A ``rosbags.highlevel.AnyReader``."""
    options: SequenceOptions

    def of_type(self, *types: str) -> list[str]:
        """Topics that hold messages of one of the types."""
        return sorted({one.topic for one in self.reader.connections if one.msgtype in types and one.msgcount > 0})

    def chosen(self, role: str, fit: list[str], preferred: list[str]) -> str:
        """The topic of a role: the one that the user names, or the only preferred one. ``fit`` are all topics that the
        user may name, ``preferred`` those that are taken unless the user names one. Raises RunFolderError if none fits,
        several do, or the named one does not.
        """
        named = self.options.topics.get(role)
        if named is not None:
            if named not in fit:
                there = ", ".join(fit) or f"none of {self._all_topics()}"
                raise RunFolderError(f"{self.path} has no topic '{named}' for {role}; {role} could be {there}.")
            return named
        if len(preferred) == 1:
            return preferred[0]
        if not fit:
            raise RunFolderError(f"{self.path} has no topic for {role}; its topics are {self._all_topics()}.")
        raise RunFolderError(
            f"{self.path} has several topics for {role} ({', '.join(fit)}); name one, as in --topic {role}={fit[0]}."
        )

    def _all_topics(self) -> str:
        return ", ".join(sorted({f"{one.topic} ({one.msgtype})" for one in self.reader.connections})) or "none"

    def messages(self, topic: str) -> Iterator[Any]:
        """All messages of a topic."""
        for connection, _, raw in self._raw(topic):
            yield self.reader.deserialize(raw, connection.msgtype)

    def first(self, topic: str) -> Any:
        """The first message of a topic; raises RunFolderError if there is none."""
        for message in self.messages(topic):
            return message
        raise RunFolderError(f"{self.path} holds no message of {topic}, although it says so; record it again.")

    def changes(self, topic: str) -> bool:
        """Whether the messages of a topic differ by more than their numbers and times."""
        start = 4 if self.reader.is2 else 0
        return len({(bytes(raw[:start]), bytes(raw[12:])) for _, _, raw in self._raw(topic)}) > 1

    def stamps(self, topic: str) -> tuple[list[Stamp], str]:
        """When each image was made, in order, and the frame of all; the images are not decoded. Raises RunFolderError
        if they are of several frames, and ValueError if there are more than are read.
        """
        stamps, frames = [], set()
        for _, at_ns, raw in self._raw(topic):
            time_s, frame = self._header(raw)
            stamps.append(Stamp(time_s, at_ns))
            frames.add(frame)
            require_count(len(stamps))
        if len(frames) > 1:
            raise RunFolderError(
                f"Images of {topic} in {self.path} are of several frames ({', '.join(sorted(map(repr, frames)))}); a "
                "sequence has one camera."
            )
        return sorted(stamps), frames.pop() if frames else ""

    def later(self, topic: str, stamp: Stamp, decode: Callable[[Any], Any]) -> Callable[[], Any]:
        """A function that reads an image; it raises RunFolderError for one that is damaged."""

        def read() -> Any:
            try:
                for connection, _, raw in self._raw(topic, stamp.at_ns, stamp.at_ns + 1):
                    # Several may have been recorded at one time.
                    if self._header(raw)[0] == stamp.time_s:
                        return decode(self.reader.deserialize(raw, connection.msgtype))
            except Exception as err:
                # Readers raise whatever the damaged bytes lead them to.
                raise RunFolderError(f"An image of {topic} in {self.path} cannot be read ({err}).") from err
            raise RunFolderError(f"An image of {topic} in {self.path} is gone.")

        return read

    def _raw(self, topic: str, *times_ns: int) -> Any:
        return self.reader.messages([one for one in self.reader.connections if one.topic == topic], *times_ns)

    def _header(self, raw: bytes) -> tuple[float, str]:
        """Time of a message that begins with a header [s], and its frame."""
        # ROS 2: four bytes say how the rest is laid out; the lowest bit of the second: little-endian. ROS 1: a number.
        ros2 = self.reader.is2
        order = "<" if not ros2 or raw[1] & 1 else ">"
        sec, nanosec, length = struct.unpack_from(f"{order}{'i' if ros2 else 'I'}II", raw, 4)
        return sec + nanosec * 1e-9, bytes(raw[16 : 16 + length]).rstrip(b"\0").decode(errors="replace")
