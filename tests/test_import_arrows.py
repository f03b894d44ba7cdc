"""Three floors, cli above them: core imports neither world nor study, world does not import study.

Within a floor, imports point down the list of rooms.
"""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

_PACKAGE = Path(__file__).resolve().parents[1] / "anm_mj"

FLOORS = {
    # What a robot needs.
    "core": (
        ("_native", "errors", "types"),
        ("frames", "protocols", "utils"),
        ("geometry", "mjcf"),
        ("robot",),
        ("control",),
        ("sensing",),
        ("mapping", "planning"),
        ("localisation",),
        ("events", "loop_state"),
        ("loop_stages",),
        ("anticipating_robot", "explore"),
    ),
    # What a simulation needs.
    "world": (("scene",), ("ground_truth", "people"), ("sim",), ("environments",)),
    # What judges, shows and keeps.
    "study": (
        ("checkpoint", "io"),
        ("viz",),
        ("evaluation",),
        ("recording", "replay", "sequence_check"),
        ("config", "export"),
        ("prior_run",),
        ("run_parts",),
        ("mapping_results", "mapping_state"),
        ("localise_images", "map_sequence", "run"),
        ("api", "bench", "resume"),
        ("ros",),
    ),
    "cli": (("cli",),),
}
"""The rooms of each floor, lowest first; a room imports lower ones, and none of those beside it."""

_RANK = {room: rank for rank, tier in enumerate(sum(FLOORS.values(), ())) for room in tier}
_FLOOR = {room: floor for floor, tiers in FLOORS.items() for tier in tiers for room in tier}

_ONLY_IN = {
    "mujoco": {"mjcf", "scene", "people", "sim", "robot", "control"},
    "dm_control": {"environments"},
    "gymnasium": {"environments"},
    "mink": {"control"},
    "pinocchio": {"robot"},
    "torch": {"mapping"},
    "meshcat": {"viz"},
    "cyclonedds": {"ros"},
}
"""Heavy packages and the only rooms that may import them. Elsewhere not even inside a function."""

_LIGHT = ("planning", "io", "viz", "environments", "sim/gl.py", "errors.py", "frames.py", "protocols.py")
"""Parts that must load without a simulator and without torch."""


def imported_modules(source: str) -> list[tuple[int, str]]:
    """Line and dotted name of every import in a module, those inside functions included.

    ``from a.b import c`` counts as ``a.b.c``, because ``c`` may be a module.
    """
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found += [(node.lineno, f"{node.module}.{alias.name}") for alias in node.names]
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in ("importlib.import_module", "import_module"):
            found += [(node.lineno, arg.value) for arg in node.args if isinstance(arg, ast.Constant)]
    return found


def violations(source: str, room: str) -> list[str]:
    """What a module in ``room`` imports and may not."""
    found = []
    for line, name in imported_modules(source):
        package, _, module = name.partition(".")
        if package == "anm_mj" and module:
            other = module.partition(".")[0]
            if other != room and _RANK[other] >= _RANK[room]:
                where = "" if _FLOOR[other] == _FLOOR[room] else f" of the floor {_FLOOR[other]}"
                found.append(f"line {line}: {room} may not import {name}{where}")
        elif room not in _ONLY_IN.get(package, {room}):
            found.append(f"line {line}: {package} belongs to {sorted(_ONLY_IN[package])}, not to {room}")
    return found


def room_of(path: Path) -> str:
    """The folder or module of the package that a file belongs to."""
    return path.relative_to(_PACKAGE).with_suffix("").parts[0]


def test_every_file_has_a_room_on_a_floor():
    assert {room_of(path) for path in _PACKAGE.rglob("*.py")} - {"__init__"} == set(_RANK) - {"_native"}


def test_no_import_points_up_or_sideways():
    found = [
        f"{path.relative_to(_PACKAGE)}, {violation}"
        for path in sorted(_PACKAGE.rglob("*.py"))
        if room_of(path) in _RANK
        for violation in violations(path.read_text(), room_of(path))
    ]

    assert not found, "\n".join(found)


def test_light_parts_load_without_heavy_packages():
    files = [file for part in _LIGHT for file in (_PACKAGE / part, *(_PACKAGE / part).rglob("*.py")) if file.is_file()]
    modules = [".".join(file.relative_to(_PACKAGE.parent).with_suffix("").parts) for file in files]
    program = f"import sys, {', '.join(modules)}; print(*{{'mujoco', 'torch'}} & set(sys.modules))"

    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert len(modules) > len(_LIGHT)
    assert done.stdout.strip() == ""


@pytest.mark.parametrize(
    ("source", "room"),
    [
        ("import anm_mj.explore", "planning"),
        ("from anm_mj.mapping.backends.torch_field import Field", "planning"),
        ("from anm_mj import cli", "sim"),
        ("def f():\n    from anm_mj.evaluation import mesh", "sim"),
        ("def f():\n    from anm_mj.scene import build", "mapping"),
        ("import torch", "planning"),
        ("def f():\n    import mujoco.viewer", "mapping"),
        ("from torch import nn", "cli"),
        ("import importlib\nimportlib.import_module('mujoco')", "io"),
        ("from anm_mj.types import Plan", "errors"),
        ("from anm_mj.recording.recorder import RunRecorder", "evaluation"),
    ],
)
def test_a_planted_arrow_is_found(source: str, room: str):
    assert len(violations(source, room)) == 1


@pytest.mark.parametrize(
    ("source", "room"),
    [
        ("from anm_mj.types import Plan\nimport numpy, scipy", "planning"),
        ("from anm_mj.planning import voronoi_graph as gvg", "planning"),
        ("import mujoco\nfrom anm_mj.scene.writer import Scene", "sim"),
        ("import torch", "mapping"),
    ],
)
def test_an_allowed_import_passes(source: str, room: str):
    assert violations(source, room) == []
