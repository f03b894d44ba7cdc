"""Imports point one way only: cli -> explore -> stages -> types; a stage never sees its sibling."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

_PACKAGE = Path(__file__).resolve().parents[1] / "anm_mj"

_BASE = {"types", "frames", "errors", "protocols", "utils", "geometry"}
_STAGES = {"scene", "sim", "mapping", "planning", "robot", "control"}

_MAY_IMPORT: dict[str, set[str]] = {
    "types": set(),
    "frames": {"types"},
    "errors": set(),
    # The compiled module, which imports nothing itself.
    "mapping.backends._native": set(),
    "utils": {"errors", "mapping.backends._native"},
    "geometry": {"types", "frames", "utils"},
    "protocols": {"types"},
    "scene": _BASE,
    "sim": _BASE | {"scene"},
    "mapping": _BASE | {"mapping.backends._native"},
    "planning": _BASE,
    "robot": _BASE,
    "control": _BASE | {"robot"},
    "io": _BASE,
    "viz": _BASE | {"io"},
    # What a checked scene looks like.
    "viz.scene_sheet": _BASE | {"viz", "scene"},
    # Reads runs, and scenes for what of them can be seen.
    "evaluation": _BASE | {"scene", "io", "viz"},
    # A policy like those of planning, but one that knows the truth.
    "evaluation.oracle.policy": _BASE | {"evaluation", "planning"},
    # Writes a run as it goes, with its numbers and pictures; what only reads a run folder never sees it.
    "io.recorder": _BASE | {"io", "io.run_log", "io.record_config", "viz", "evaluation"},
    # Its logs, with depth reduced as the evaluation reads it.
    "io.run_log": _BASE | {"io", "io.record_config", "evaluation"},
    # Composes the stages' configurations, which stand beside their stages.
    "config": _BASE | _STAGES | {"io.record_config", "checkpoint"},
    "io.record_config": _BASE,
    # Knows nothing of what it stores.
    "checkpoint": _BASE,
    # Builds the robot that explore drives out of simulator, camera and drive.
    "sim.make_robot": _BASE | {"config", "scene", "sim", "robot", "control"},
    # Renders a finished run again: its own views, and its map from where the robot never stood.
    "evaluation.rerender": _BASE | {"io", "scene", "robot", "control", "sim.make_robot"},
    "evaluation.novel_views": _BASE
    | {"io", "scene", "robot", "control", "sim.make_robot", "evaluation", "evaluation.rerender", "mapping"},
    "evaluation.fixed_views": _BASE
    | {"io", "scene", "robot", "sim.make_robot", "evaluation", "evaluation.rerender", "evaluation.novel_views"}
    | {"mapping"},
    # A finished run, frame by frame: page and film. Asks the map how certain it is.
    "replay": _BASE | {"io", "viz", "evaluation", "evaluation.rerender", "mapping"},
    # A finished run in the formats of other tools; asks the map for its distances.
    "export": _BASE | {"io", "viz", "evaluation", "replay", "mapping"},
    # The same for a recorded sequence, without simulator and evaluation of its own.
    "map_sequence": _BASE | {"config", "io", "io.run_log", "mapping", "planning", "viz"},
    "depth_outliers": _BASE,
    "pose_check": _BASE | {"control"},
    "sensor_monitor": _BASE | {"depth_outliers", "pose_check"},
    # Sees map, recorder, viewer and evaluation only through the protocols.
    "explore": _BASE | _STAGES | {"sensor_monitor"},
    # Puts everything together for one run.
    "run": _BASE
    | _STAGES
    | {"config", "sim.make_robot", "explore", "io", "io.recorder", "viz", "evaluation", "checkpoint", "former_run"},
    # A finished run as what another one goes on from.
    "former_run": _BASE | {"config", "io", "mapping", "evaluation"},
    # The same run, from where it was stored.
    "resume": _BASE | _STAGES | {"config", "run", "explore", "io", "io.recorder", "viz", "evaluation", "checkpoint"},
    # What users import: runs, maps and their parts.
    "api": _BASE | _STAGES | {"config", "run", "explore", "io", "evaluation"},
    # Episodes to learn in: a robot in its scene, rewarded by what the evaluation counts; maps occupancy only.
    "environments": _BASE | {"config", "sim.make_robot", "scene", "sim", "robot", "control", "mapping", "evaluation"},
    # Many runs, each in a process of its own, and their tables.
    "bench": _BASE
    | {"robot", "scene", "planning", "config", "run", "io", "viz"}
    | {"evaluation", "evaluation.novel_views", "evaluation.fixed_views"},
    "cli.metrics_table": _BASE | {"evaluation"},
    "cli.progress": _BASE | {"explore", "io.recorder", "evaluation"},
    "cli.doctor": _BASE | {"sim", "io", "viz"},
    "cli.doctor_report": _BASE | {"io", "cli.doctor"},
    "cli": _BASE
    | _STAGES
    | {
        "config",
        "run",
        "resume",
        "bench",
        "cli.metrics_table",
        "cli.progress",
        "cli.doctor",
        "cli.doctor_report",
        "io",
        "viz",
        "viz.scene_sheet",
        "evaluation",
        "evaluation.novel_views",
        "evaluation.fixed_views",
        "replay",
        "export",
        "map_sequence",
    },
}
"""What each module or folder of the package may import from the package, beside itself."""

_ONLY_IN = {
    "mujoco": {"scene", "sim", "robot", "control"},
    "dm_control": {"environments"},
    "gymnasium": {"environments"},
    "mink": {"control"},
    "pinocchio": {"robot"},
    "torch": {"mapping"},
    "meshcat": {"viz"},
}
"""Heavy packages and the only places that may import them. Elsewhere not even inside a function."""

_LIGHT = ("planning", "evaluation", "io", "viz", "environments", "sim/gl.py", "errors.py", "frames.py", "protocols.py")
"""Parts that must load without a simulator and without torch, but for what stands in ``_MAPS``."""
_MAPS = {"evaluation.novel_views", "evaluation.fixed_views"}


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


def place_of(module: str) -> str:
    """The key of _MAY_IMPORT for a dotted name below anm_mj: its longest prefix that stands there."""
    parts = module.split(".")
    prefixes = (".".join(parts[:k]) for k in range(len(parts), 0, -1))
    return next((prefix for prefix in prefixes if prefix in _MAY_IMPORT), parts[0])


def violations(source: str, place: str) -> list[str]:
    """What a module in ``place`` imports and may not."""
    found = []
    for line, name in imported_modules(source):
        package, _, module = name.partition(".")
        if package == "anm_mj" and module:
            if place_of(module) not in {place, *_MAY_IMPORT[place]}:
                found.append(f"line {line}: {place} may not import {name}")
        elif place.split(".")[0] not in _ONLY_IN.get(package, {place.split(".")[0]}):
            found.append(f"line {line}: {package} belongs to {sorted(_ONLY_IN[package])}, not to {place}")
    return found


def _place(path: Path) -> str:
    return place_of(".".join(path.relative_to(_PACKAGE).with_suffix("").parts))


def test_every_module_has_a_place_in_the_order():
    places = {_place(path) for path in _PACKAGE.rglob("*.py")} - {"__init__"}

    assert places <= set(_MAY_IMPORT)


def test_no_import_points_back_or_sideways():
    found = [
        f"{path.relative_to(_PACKAGE)}, {violation}"
        for path in sorted(_PACKAGE.rglob("*.py"))
        if _place(path) in _MAY_IMPORT
        for violation in violations(path.read_text(), _place(path))
    ]

    assert not found, "\n".join(found)


def test_light_parts_load_without_heavy_packages():
    files = [
        file
        for part in _LIGHT
        for file in (_PACKAGE / part, *(_PACKAGE / part).rglob("*.py"))
        if file.is_file() and _place(file) not in _MAPS
    ]
    modules = [".".join(file.relative_to(_PACKAGE.parent).with_suffix("").parts) for file in files]
    program = f"import sys, {', '.join(modules)}; print(*{{'mujoco', 'torch'}} & set(sys.modules))"

    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert len(modules) > len(_LIGHT)
    assert done.stdout.strip() == ""


@pytest.mark.parametrize(
    ("source", "place"),
    [
        ("import anm_mj.explore", "planning"),
        ("from anm_mj.mapping.field import Field", "planning"),
        ("from anm_mj import cli", "sim"),
        ("def f():\n    from anm_mj.control import drive", "sim"),
        ("import torch", "planning"),
        ("def f():\n    import mujoco.viewer", "mapping"),
        ("from torch import nn", "cli"),
        ("import importlib\nimportlib.import_module('mujoco')", "io"),
        ("from anm_mj.types import Plan", "errors"),
        ("from anm_mj.io.recorder import RunRecorder", "evaluation"),
        ("from anm_mj.io import recorder", "viz"),
    ],
)
def test_a_planted_arrow_is_found(source: str, place: str):
    assert len(violations(source, place)) == 1


@pytest.mark.parametrize(
    ("source", "place"),
    [
        ("from anm_mj.types import Plan\nimport numpy, scipy", "planning"),
        ("from anm_mj.planning import voronoi_graph as gvg", "planning"),
        ("import mujoco\nfrom anm_mj.scene.writer import Scene", "sim"),
        ("import torch", "mapping"),
    ],
)
def test_an_allowed_import_passes(source: str, place: str):
    assert violations(source, place) == []
