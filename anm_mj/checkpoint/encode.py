"""An object graph as plain data: a list of nodes in JSON and a list of arrays.

A node is a list that begins with its kind. A value inside a node is a number, a text, a truth value or None as it is,
or ``[index]`` of the node that it refers to. Objects that are shared, or refer to one another in circles, are one node.
Arrays that share memory stay views of the same memory.
"""

import base64
import enum
import types
from collections import Counter, OrderedDict, defaultdict, deque
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from anm_mj.checkpoint.known_classes import KnownClasses, attributes_of, name_of
from anm_mj.errors import CheckpointError

MAX_INLINE_BYTES = 256
"""Smaller arrays stand among the nodes, as text."""
_MAX_OWNER_SHARE = 4
"""A strided view is stored with the whole array it looks at unless that is this many times larger."""
SEQUENCES: dict[str, type] = {"list": list, "tuple": tuple, "set": set, "frozenset": frozenset}
MAPPINGS: dict[str, type] = {"dict": dict, "ordered": OrderedDict, "counter": Counter}
FACTORIES: dict[str, type] = {"list": list, "dict": dict, "set": set, "int": int, "float": float}
_SEQUENCE_KINDS = {cls: kind for kind, cls in SEQUENCES.items()}
_MAPPING_KINDS = {cls: kind for kind, cls in MAPPINGS.items()}
_FACTORY_KINDS = {cls: kind for kind, cls in FACTORIES.items()}
_PLAIN = (type(None), bool, int, float, str)


@dataclass
class Graph:
    """A state as plain data."""

    nodes: list[Any] = field(default_factory=list)
    arrays: list[np.ndarray] = field(default_factory=list)
    """One-dimensional, of bytes; views of the live arrays."""

    @property
    def num_bytes(self) -> int:
        """Size of all arrays [bytes]."""
        return sum(array.nbytes for array in self.arrays)


def encode(roots: dict[str, Any], known: KnownClasses | None = None) -> Graph:
    """The state of some objects and of everything that they refer to. ``roots`` have the names that
    :func:`anm_mj.checkpoint.decode.restore` is given the new ones under; ``known`` None = the classes of this package.
    Raises CheckpointError if an object cannot be stored; the message says where it lies and of which class it is.
    """
    return _Encoder(known or KnownClasses()).encode(roots)


class _Encoder:
    def __init__(self, known: KnownClasses) -> None:
        self._known = known
        self._graph = Graph()
        self._index: dict[int, int] = {}
        self._kept: list[Any] = []
        """Keeps what was met alive, so that no other object gets its id."""
        self._queue: deque[tuple[int, Any, str, str | None]] = deque()
        self._arrays: list[tuple[int, np.ndarray]] = []

    def encode(self, roots: dict[str, Any]) -> Graph:
        self._graph.nodes.append(None)
        self._graph.nodes[0] = ["roots", {name: self._value(thing, name, name) for name, thing in roots.items()}]
        while self._queue:
            index, thing, where, path = self._queue.popleft()
            self._graph.nodes[index] = self._node(index, thing, where, path)
        self._store_arrays()
        return self._graph

    def _value(self, thing: Any, where: str, path: str | None = None) -> Any:
        if type(thing) in _PLAIN:
            return thing
        found = self._index.get(id(thing))
        if found is None:
            found = len(self._graph.nodes)
            self._graph.nodes.append(None)
            self._index[id(thing)] = found
            self._kept.append(thing)
            self._queue.append((found, thing, where, path))
        return [found]

    def _node(self, index: int, thing: Any, where: str, path: str | None) -> Any:
        kind = type(thing)
        inside = f"{where}[]"
        if kind in _SEQUENCE_KINDS:
            return [_SEQUENCE_KINDS[kind], [self._value(item, inside) for item in thing]]
        if kind in _MAPPING_KINDS:
            return [_MAPPING_KINDS[kind], *self._items(thing, where)]
        if kind is deque:
            return ["deque", [self._value(item, inside) for item in thing], thing.maxlen]
        if kind is defaultdict and (thing.default_factory in _FACTORY_KINDS or thing.default_factory is None):
            return ["defaultdict", *self._items(thing, where), _FACTORY_KINDS.get(cast(type, thing.default_factory))]
        if kind is np.ndarray:
            self._arrays.append((index, thing))
            return None
        if isinstance(thing, np.generic):
            return ["scalar", thing.dtype.str, base64.b64encode(thing.tobytes()).decode()]
        if kind is np.random.Generator:
            state = thing.bit_generator.state
            return ["generator", self._value(state, where)]
        if kind in (types.FunctionType, type):
            return self._named("function" if kind is types.FunctionType else "class", thing, where)
        if kind is types.MethodType:
            self._require(thing.__func__.__module__, thing, where)
            return ["method", self._value(thing.__self__, where), thing.__func__.__name__]
        if kind is slice:
            return ["slice", *(self._value(part, where) for part in (thing.start, thing.stop, thing.step))]
        if isinstance(thing, enum.Enum):
            self._require(kind.__module__, thing, where)
            return ["enum", name_of(kind), thing.name]
        return self._object(thing, where, path)

    def _items(self, thing: dict[Any, Any], where: str) -> tuple[list[Any], list[Any]]:
        inside = f"{where}[]"
        return [self._value(key, inside) for key in thing], [self._value(value, inside) for value in thing.values()]

    def _object(self, thing: Any, where: str, path: str | None) -> Any:
        kind = type(thing)
        self._require(kind.__module__, thing, where, in_place=path is not None)
        if isinstance(thing, tuple):
            return ["namedtuple", name_of(kind), [self._value(item, f"{where}[]") for item in thing]]
        if isinstance(thing, (list, dict, set, frozenset, np.ndarray)):
            raise CheckpointError(f"{where} is a {name_of(kind)}, which checkpoints do not hold.")
        attributes = attributes_of(thing)
        values = {
            name: self._value(value, f"{where}.{name}", None if path is None else f"{path}.{name}")
            for name, value in attributes.items()
        }
        extra = thing.get_state() if hasattr(thing, "get_state") else None
        return ["object", name_of(kind), path, values, self._value(extra, f"{where}.get_state()")]

    def _named(self, kind: str, thing: Any, where: str) -> Any:
        self._require(thing.__module__, thing, where)
        if "<" in thing.__qualname__:
            raise CheckpointError(f"{where} is the local function {thing.__qualname__}, which checkpoints do not hold.")
        return [kind, name_of(thing)]

    def _require(self, module: str, thing: Any, where: str, *, in_place: bool = False) -> None:
        # What the new run makes may be of any class of the package, such as the recorder's.
        if self._known.allows(module) or (in_place and module.startswith("anm_mj.")):
            return
        raise CheckpointError(f"{where} is a {name_of(type(thing))}, which checkpoints do not hold.")

    def _store_arrays(self) -> None:
        owners: dict[int, list[np.ndarray]] = {}
        for _, array in self._arrays:
            owners.setdefault(id(_owner(array)), []).append(array)
        stored: dict[int, int] = {}
        for index, array in self._arrays:
            if array.dtype.hasobject:
                raise CheckpointError(f"An array of objects, of shape {array.shape}, cannot be stored.")
            owner = _owner(array)
            sharing = owners[id(owner)]
            shared = any(other is not array and np.may_share_memory(other, array) for other in sharing)
            strided = _axes_order(array) is None and owner.nbytes <= _MAX_OWNER_SHARE * max(array.nbytes, 1)
            if (shared or strided) and array.size:
                if id(owner) not in stored:
                    stored[id(owner)] = len(self._graph.arrays)
                    self._graph.arrays.append(_bytes_of(owner))
                offset = _address(array) - _address(owner)
                node = ["view", stored[id(owner)], offset, list(array.strides)]
            else:
                order = _axes_order(array)
                order = list(range(array.ndim)) if order is None else order
                data = _bytes_of(np.ascontiguousarray(array.transpose(order)))
                if data.nbytes <= MAX_INLINE_BYTES:
                    node = ["inline", base64.b64encode(data.tobytes()).decode(), order]
                else:
                    node = ["array", len(self._graph.arrays), order]
                    self._graph.arrays.append(data)
            self._graph.nodes[index] = [*node, _dtype_text(array.dtype), list(array.shape), array.flags.writeable]


def _owner(array: np.ndarray) -> np.ndarray:
    """The array that the memory of a view belongs to."""
    owner = array
    while isinstance(owner.base, np.ndarray):
        owner = owner.base
    return owner if owner.flags.c_contiguous or owner.flags.f_contiguous else array


def _address(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]


def _bytes_of(array: np.ndarray) -> np.ndarray:
    """The memory of a contiguous array as bytes."""
    flat = array.T if not array.flags.c_contiguous else array
    return np.frombuffer(flat, np.uint8) if flat.nbytes else np.zeros(0, np.uint8)


def _axes_order(array: np.ndarray) -> list[int] | None:
    """The order of the axes in which an array is contiguous; None where it is not."""
    if array.flags.c_contiguous:
        return list(range(array.ndim))
    order = sorted(range(array.ndim), key=lambda axis: -abs(array.strides[axis]))
    return order if array.transpose(order).flags.c_contiguous else None


def _dtype_text(dtype: np.dtype) -> Any:
    return dtype.str if dtype.fields is None else [list(part) for part in dtype.descr]
