"""ROS 2 message types as types of DDS, from the definitions that rosbags ships."""

from typing import Any

from cyclonedds.idl import make_idl_struct
from cyclonedds.idl import types as idl
from rosbags.interfaces import Nodetype

_NUMBERS = ("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64", "float32", "float64")
_BASE = {name: getattr(idl, name) for name in _NUMBERS} | {
    "bool": bool,
    "string": str,
    "byte": idl.uint8,
    "char": idl.uint8,
    "octet": idl.uint8,
}


class DdsTypes:
    """Makes the type of DDS for a message, such as ``sensor_msgs::msg::dds_::Image_``, and those of its parts.

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
