"""Lays a stored state over newly made objects.

An object that has its place in a newly made run, found by the attributes that lead to it, is filled in place, so that
whoever holds it sees the stored state. All others are made without their constructors. Nothing is changed before the
whole state has been read.
"""

import base64
import math
from collections import defaultdict, deque
from collections.abc import Callable
from functools import partial
from types import FunctionType
from typing import Any

import numpy as np

from anm_mj.checkpoint.encode import FACTORIES, MAPPINGS, SEQUENCES
from anm_mj.checkpoint.known_classes import KnownClasses, attributes_of, name_of, rebuilt_names
from anm_mj.errors import AnmError, CheckpointError

_BIT_GENERATORS = ("PCG64", "PCG64DXSM", "MT19937", "Philox", "SFC64")
_MAX_DEPTH = 50
"""Tuples are nested no deeper than this."""


def restore(nodes: list[Any], arrays: list[np.ndarray], roots: dict[str, Any], known: KnownClasses) -> dict[str, Any]:
    """Fill objects with a stored state. ``nodes`` and ``arrays`` are as :class:`anm_mj.checkpoint.encode.Graph` has
    them, ``roots`` newly made objects by their names, None for what the state itself has to bring. Returns the objects
    by their names, those that the state brought among them. Raises CheckpointError if the state is damaged, or that of
    another version or of other objects. Nothing has been changed then, unless one of the objects refuses its state at
    the end.
    """
    try:
        return _Decoder(nodes, arrays, roots, known).restore()
    except AnmError:
        raise
    except (TypeError, ValueError, KeyError, IndexError, AttributeError, OverflowError, RecursionError) as err:
        raise CheckpointError(f"It cannot be understood ({type(err).__name__}: {err}).") from err


class _Decoder:
    def __init__(self, nodes: list[Any], arrays: list[np.ndarray], roots: dict[str, Any], known: KnownClasses) -> None:
        self._nodes, self._arrays, self._roots, self._known = nodes, arrays, roots, known
        self._made: dict[int, Any] = {}
        self._in_place: dict[int, int] = {}
        """Newly made objects that are filled in place, by id, and their nodes."""
        self._owners: dict[int, np.ndarray] = {}
        self._unfinished: list[Callable[[], None]] = []
        self._depth = 0

    def restore(self) -> dict[str, Any]:
        for index, node in enumerate(self._nodes):
            if not isinstance(node, list) or not node or not isinstance(node[0], str):
                raise CheckpointError(f"Its node {index} has no kind.")
            if node[0] == "object":
                self._made[index] = self._shell(index, *node[1:4])
        for index, node in enumerate(self._nodes[1:], start=1):
            if node[0] != "object":
                self._thing(index)
        found = {name: self._value(value) for name, value in self._nodes[0][1].items()}
        for name, thing in self._roots.items():
            if thing is not None and found.get(name) is not thing:
                raise CheckpointError(f"It holds no {name} of the class that this run has.")
        filled = [self._attributes(index, node) for index, node in enumerate(self._nodes) if node[0] == "object"]
        # From here on nothing is read any more, only put in place.
        for fill in filled:
            fill()
        for fill in self._unfinished:
            fill()
        for index, node in enumerate(self._nodes):
            if node[0] == "object" and hasattr(self._made[index], "set_state"):
                self._made[index].set_state(self._value(node[4]))
        return found

    def _value(self, value: Any) -> Any:
        return self._thing(value[0]) if isinstance(value, list) else value

    def _thing(self, index: int) -> Any:
        if type(index) is not int or not 0 < index < len(self._nodes):
            raise CheckpointError(f"It refers to node {index!r} of {len(self._nodes)}.")
        if index not in self._made:
            self._depth += 1
            if self._depth > _MAX_DEPTH:
                raise CheckpointError("Its nodes are nested too deeply.")
            node = self._nodes[index]
            self._make(index, node[0], node[1:])
            self._depth -= 1
        return self._made[index]

    def _make(self, index: int, kind: str, node: list[Any]) -> None:
        if kind in ("list", "set", "deque"):
            made = deque(maxlen=node[1]) if kind == "deque" else SEQUENCES[kind]()
            self._made[index] = made
            self._unfinished.append(partial(self._fill_sequence, made, node[0]))
        elif kind in MAPPINGS or kind == "defaultdict":
            factory = None if kind != "defaultdict" or node[2] is None else FACTORIES[node[2]]
            made = defaultdict(factory) if kind == "defaultdict" else MAPPINGS[kind]()
            self._made[index] = made
            self._unfinished.append(partial(self._fill_mapping, made, node[0], node[1]))
        else:
            self._made[index] = self._whole(kind, node)

    def _whole(self, kind: str, node: list[Any]) -> Any:
        """A thing that is made at once, of parts that are there already."""
        if kind in ("tuple", "frozenset"):
            return SEQUENCES[kind](self._value(item) for item in node[0])
        if kind in ("array", "inline", "view"):
            return self._array(kind, node)
        if kind == "scalar":
            return np.frombuffer(base64.b64decode(node[1]), _dtype(node[0]))[0]
        if kind == "generator":
            return _generator(self._plain(node[0]))
        if kind == "function":
            found = self._known.find(node[0])
            if not callable(found) or isinstance(found, type):
                raise CheckpointError(f"It names {node[0]!r}, which is no function.")
            return found
        if kind == "class":
            return self._known.find_class(node[0])
        if kind == "method":
            return self._method(self._value(node[0]), node[1])
        if kind == "slice":
            return slice(*(self._value(part) for part in node))
        if kind == "enum":
            return self._known.find_class(node[0])[node[1]]  # type: ignore[index]
        if kind == "namedtuple":
            cls = self._known.find_class(node[0])
            if not issubclass(cls, tuple):
                raise CheckpointError(f"It takes {node[0]!r} for a tuple.")
            return tuple.__new__(cls, [self._value(item) for item in node[1]])
        raise CheckpointError(f"It holds a node of the unknown kind {kind!r}.")

    def _plain(self, value: Any) -> Any:
        """A nested container of plain values, at once."""
        if not isinstance(value, list):
            return value
        node = self._nodes[value[0]]
        if node[0] in ("list", "tuple"):
            return SEQUENCES[node[0]](self._plain(item) for item in node[1])
        if node[0] == "dict":
            return dict(zip(map(self._plain, node[1]), map(self._plain, node[2]), strict=True))
        return self._value(value)

    def _fill_sequence(self, made: Any, items: list[Any]) -> None:
        values = [self._value(item) for item in items]
        made.update(values) if isinstance(made, set) else made.extend(values)

    def _fill_mapping(self, made: Any, keys: list[Any], values: list[Any]) -> None:
        for key, value in zip(keys, values, strict=True):
            made[self._value(key)] = self._value(value)

    def _method(self, owner: Any, name: str) -> Any:
        function = next((vars(base)[name] for base in type(owner).__mro__ if name in vars(base)), None)
        if not callable(function) or name.startswith("__") or not self._known.allows(type(owner).__module__):
            raise CheckpointError(f"It names the method {name!r} of {name_of(type(owner))}, which there is not.")
        return getattr(owner, name)

    def _array(self, kind: str, node: list[Any]) -> np.ndarray:
        dtype, shape, writeable = _dtype(node[-3]), tuple(node[-2]), node[-1]
        if kind == "view":
            if node[0] not in self._owners:
                self._owners[node[0]] = self._arrays[node[0]].copy()
            # numpy refuses a view that reaches beyond its memory.
            array = np.ndarray(shape, dtype, self._owners[node[0]].data, node[1], tuple(node[2]))
        else:
            order = node[1]
            stored = tuple(shape[axis] for axis in order)
            if kind == "inline":
                data = np.frombuffer(bytearray(base64.b64decode(node[0])), np.uint8)
            else:
                data = self._arrays[node[0]].copy()
            if sorted(order) != list(range(len(shape))) or data.nbytes != math.prod(stored) * dtype.itemsize:
                raise CheckpointError(f"An array of shape {shape} has another size.")
            array = data.view(dtype) if data.nbytes else np.zeros(0, dtype)
            array = array.reshape(stored).transpose(np.argsort(order).tolist())
        array.flags.writeable = bool(writeable)
        return array

    def _shell(self, index: int, name: str, path: str | None, values: dict[str, Any]) -> Any:
        """The newly made object in the place of a stored one, or an empty one of its class."""
        fresh = None if path is None else self._at(path)
        if fresh is not None and name_of(type(fresh)) == name and id(fresh) not in self._in_place:
            missing = set(attributes_of(fresh)) - set(values)
            if missing:
                raise CheckpointError(f"It lacks {path}.{min(missing)}: another version wrote it.")
            # What is frozen may be shared with what is not restored, or, as a default, with the whole program.
            if not (_is_frozen(type(fresh)) and self._known.allows(type(fresh).__module__)):
                self._in_place[id(fresh)] = index
                return fresh
        cls: Any = self._known.find_class(name)
        if rebuilt_names(cls) or hasattr(cls, "set_state"):
            raise CheckpointError(f"It holds a {name} at {path} that a new run does not have.")
        return cls.__new__(cls)

    def _at(self, path: str) -> Any:
        root, *names = path.split(".")
        thing = self._roots.get(root)
        for name in names:
            thing = attributes_of(thing).get(name) if type(thing).__module__ != "builtins" else None
        return thing

    def _attributes(self, index: int, node: list[Any]) -> Callable[[], None]:
        thing, left_out = self._made[index], rebuilt_names(type(self._made[index]))
        values = {name: self._value(value) for name, value in node[3].items() if name not in left_out}
        for name in values:
            # Otherwise a checkpoint could have another function called in the place of a method.
            if isinstance(getattr(type(thing), name, None), (FunctionType, property)):
                raise CheckpointError(f"It puts something in the place of the method {name} of {node[1]}.")

        def fill() -> None:
            for name, value in values.items():
                object.__setattr__(thing, name, value)

        return fill


def _is_frozen(cls: type) -> bool:
    """Whether objects of a class are values, all of which a checkpoint holds."""
    parameters = getattr(cls, "__dataclass_params__", None)
    return bool(parameters and parameters.frozen) and not rebuilt_names(cls) and not hasattr(cls, "set_state")


def _dtype(text: Any) -> np.dtype:
    """A data type without objects."""
    dtype = np.dtype(text if isinstance(text, str) else [(*part[:2], *map(tuple, part[2:])) for part in text])
    if dtype.hasobject:
        raise CheckpointError("It holds an array of objects.")
    return dtype


def _generator(state: dict[str, Any]) -> np.random.Generator:
    name = state["bit_generator"]
    if name not in _BIT_GENERATORS:
        raise CheckpointError(f"It holds a random generator of the unknown kind {name!r}.")
    bits = getattr(np.random, name)(0)
    bits.state = state
    return np.random.Generator(bits)
