import json
import threading
from collections import Counter, OrderedDict, defaultdict, deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from anm_mj.checkpoint.decode import restore
from anm_mj.checkpoint.encode import encode
from anm_mj.checkpoint.known_classes import KnownClasses, name_of
from anm_mj.errors import CheckpointError
from anm_mj.mapping.keyframes import PIXEL
from anm_mj.types import Action, Plan, Pose2

KNOWN = KnownClasses(__name__)


class Box:
    """Stands for any object with state."""

    def __init__(self, **values: Any):
        vars(self).update(values)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(name)


class Slotted:
    __slots__ = ("left", "right")


class WithParts:
    REBUILT = ("tool",)

    def __init__(self, tool):
        self.tool, self.count = tool, 0

    def get_state(self):
        return {"size": len(self.tool)}

    def set_state(self, state):
        self.tool = ["again"] * state["size"]


@dataclass(frozen=True)
class Key:
    x: int
    y: int


def there_and_back(thing, fresh=None, known=KNOWN):
    graph = encode({"root": thing}, known)
    nodes, arrays = json.loads(json.dumps(graph.nodes)), [array.copy() for array in graph.arrays]
    return restore(nodes, arrays, {"root": fresh}, known)["root"]


class Walker:
    def __init__(self):
        self.steps = 0

    def walk(self):
        self.steps += 1


def test_nothing_takes_the_place_of_a_method():
    walker = Walker()
    vars(walker)["walk"] = there_and_back
    with pytest.raises(CheckpointError, match="in the place of the method walk"):
        there_and_back(walker)


def test_containers_and_numbers_come_back_as_they_were():
    named = {Key(1, 2): "a", (3, (4, 5)): [True, None, 1.0, -0.0, 2**70], "inf": float("inf")}
    box = Box(
        named=named,
        ordered=OrderedDict(b=1, a=2),
        counted=Counter("aab"),
        by_default=defaultdict(list, {1: [2]}),
        queue=deque([1, 2], maxlen=3),
        places={(1, 2), (3, 4)},
        fixed=frozenset({5}),
        action=Action.TURN_LEFT,
        part=slice(1, None),
        scalar=np.float32(0.1),
        kind=Plan,
    )
    again = there_and_back(box)
    assert vars(again) == vars(box)
    assert [type(value) for value in vars(again).values()] == [type(value) for value in vars(box).values()]
    assert again.queue.maxlen == 3
    assert np.copysign(1.0, again.named[3, (4, 5)][3]) == -1.0
    again.by_default[7].append(1)


def test_shared_and_circular_references_are_kept():
    pose = Pose2(1.0, 2.0, 3.0)
    box = Box(first=pose, second=[pose], slotted=Slotted())
    box.slotted.left, box.slotted.right = box, box.second
    again = there_and_back(box)
    assert again.second[0] is again.first
    assert again.slotted.left is again
    assert again.slotted.right is again.second


@pytest.mark.parametrize(
    "array",
    [
        np.arange(6.0).reshape(2, 3),
        np.asfortranarray(np.arange(2000.0).reshape(40, 50)),
        np.arange(24).reshape(2, 3, 4).transpose(2, 0, 1),
        np.arange(1000.0)[::-3],
        np.zeros((0, 3)),
        np.array(5),
        np.array([("ab", 1.0)], [("name", "U4"), ("value", "<f4")]),
        np.zeros(100, PIXEL),
        np.array([np.nan, np.inf, -0.0]),
        np.array([True, False]),
    ],
    ids=lambda array: f"{array.dtype}{array.shape}",
)
def test_arrays_keep_their_bytes_and_their_layout(array):
    again = there_and_back(Box(array=array)).array
    assert again.dtype == array.dtype
    assert again.tobytes() == array.tobytes()
    assert again.shape == array.shape
    assert array.size == 0 or array.ndim == 0 or again.strides == array.strides


def test_views_of_one_array_still_share_its_memory():
    whole = np.zeros((10, 100))
    again = there_and_back(Box(part=whole[2:4, ::2], whole=whole))
    again.whole[3, 4] = 7.0
    assert again.part[1, 2] == 7.0
    fixed = np.zeros(3)
    fixed.flags.writeable = False
    assert not there_and_back(Box(fixed=fixed)).fixed.flags.writeable


@pytest.mark.parametrize("bits", [np.random.PCG64, np.random.MT19937, np.random.Philox, np.random.SFC64])
def test_random_generators_go_on_and_stay_shared(bits):
    generator = np.random.Generator(bits(5))
    generator.random(3)
    again = there_and_back(Box(a=generator, b=generator))
    assert again.a is again.b
    assert again.a.random(4).tolist() == generator.random(4).tolist()


def test_a_method_of_a_stored_object_is_that_of_the_new_one():
    box = Box(table=Counter())
    vars(box)["hook"] = Pose2(1.0, 2.0, 0.0).__hash__
    with pytest.raises(CheckpointError, match="method"):
        there_and_back(box)


def test_an_object_of_the_new_run_is_filled_in_place():
    old, fresh = Box(inner=Box(value=np.arange(3))), Box(inner=Box(value=np.zeros(3)))
    inner = fresh.inner
    assert there_and_back(old, fresh) is fresh
    assert fresh.inner is inner
    assert inner.value.tolist() == [0, 1, 2]


def test_what_the_constructor_makes_is_left_out_and_told_its_own_state():
    old, fresh = WithParts([open, open]), WithParts([])
    old.count = 4
    assert there_and_back(Box(parts=old), Box(parts=fresh)).parts is fresh
    assert fresh.count == 4
    assert fresh.tool == ["again", "again"]


def test_state_of_an_older_version_is_refused_by_the_name_of_what_it_lacks():
    with pytest.raises(CheckpointError, match=r"root\.new"):
        there_and_back(Box(old=1), Box(old=1, new=2))


@pytest.mark.parametrize(
    ("thing", "named"),
    [(threading.Lock(), "lock"), (lambda: 0, "<lambda>"), (iter([]), "iterator"), (object(), "object")],
    ids=["lock", "lambda", "iterator", "object"],
)
def test_what_cannot_be_stored_is_named_with_its_place(thing, named):
    with pytest.raises(CheckpointError, match=named) as caught:
        encode({"policy": Box(left=[thing])}, KNOWN)
    assert "policy.left[]" in str(caught.value)


def test_a_class_of_another_module_takes_part_only_where_it_was_named():
    with pytest.raises(CheckpointError, match="Box"):
        encode({"root": [Box()]})


CALLED = []


class Trap:
    def __init__(self):
        CALLED.append("init")

    def __setstate__(self, state):
        CALLED.append("setstate")

    def __reduce__(self):
        CALLED.append("reduce")
        return CALLED.append, ("reduced",)

    def __setattr__(self, name, value):
        CALLED.append("setattr")


def test_objects_are_made_without_any_code_of_their_class():
    trap = Trap.__new__(Trap)
    vars(trap)["value"] = 5
    CALLED.clear()
    assert there_and_back([trap])[0].value == 5
    assert CALLED == []


HOSTILE = [
    ["object", "os:system", None, {}, None],
    ["object", "builtins:object", None, {}, None],
    ["object", "subprocess:Popen", None, {"args": "touch x"}, None],
    ["object", "anm_mj.io.jsonl:LineWriter", None, {}, None],
    ["object", "anm_mj.types.plan:Nothing", None, {}, None],
    ["object", "anm_mj.types.plan:np.ndarray", None, {}, None],
    ["class", "builtins:eval"],
    ["class", "anm_mj.errors:AnmError"],
    ["function", "os:system"],
    ["function", "anm_mj.mapping.neural_map:pickle.loads"],
    ["function", "anm_mj.types.motion:math.floor"],
    ["enum", "anm_mj.types:Action", "mro"],
    ["enum", "anm_mj.types.observation:Pose2", "x_m"],
    ["method", [2], "__reduce__"],
    ["method", [2], "clear"],
    ["generator", [2]],
    ["scalar", "O", "AAAAAAAAAAA="],
    ["inline", "AAAAAAAAAAA=", [0], "O", [1], True],
    ["inline", "AAAA", [0], "<f8", [1 << 40], True],
    ["inline", "AAAA", [0], [["a", "O"]], [1], True],
    ["view", 0, 0, [-8], "<f8", [5], True],
    ["view", 0, 1 << 40, [8], "<f8", [5], True],
    ["array", 5, [0], "<f8", [2], True],
    ["array", 0, [7], "<f8", [2], True],
    ["list", [[99]]],
    ["list", [["a"]]],
    ["tuple", [[1]]],
    ["nothing"],
    [],
    None,
    {"kind": "list"},
    ["defaultdict", [], [], "eval"],
    ["namedtuple", "anm_mj.types.observation:Pose2", []],
]


@pytest.mark.parametrize("node", HOSTILE, ids=lambda node: json.dumps(node)[:60])
def test_a_hostile_node_is_refused_and_runs_nothing(node):
    nodes = [["roots", {"root": [1]}], node, ["list", []]]
    with pytest.raises(CheckpointError):
        restore(nodes, [np.zeros(16, np.uint8)], {"root": None}, KnownClasses())


def test_nothing_is_changed_where_the_state_cannot_be_read():
    graph = encode({"root": Box(a=1, b=[2])}, KNOWN)
    graph.nodes.append(["function", "os:system"])
    fresh = Box(a=0, b=[0])
    with pytest.raises(CheckpointError):
        restore(graph.nodes, graph.arrays, {"root": fresh}, KNOWN)
    assert vars(fresh) == {"a": 0, "b": [0]}


def test_names_are_those_of_module_and_class():
    assert name_of(Pose2) == "anm_mj.types.observation:Pose2"
    assert KnownClasses().find_class("anm_mj.types.observation:Pose2") is Pose2
    assert replace(Pose2(1.0, 2.0, 0.0), x_m=3.0) == there_and_back([Pose2(3.0, 2.0, 0.0)])[0]
