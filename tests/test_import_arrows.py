"""Imports point one way only: cli -> explore -> stages -> types; a stage never sees its sibling."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

_PACKAGE = Path(__file__).resolve().parents[1] / "anm_mj"

_BASE = {"types", "frames", "errors", "protocols", "stopwatch"}
_STAGES = {"scene", "sim", "mapping", "planning", "control"}
_READERS = {"evaluation", "viz", "io"}
_EVERYTHING = _BASE | _STAGES | _READERS | {"config", "explore", "robots"}

_MAY_IMPORT: dict[str, set[str]] = {
    "types": set(),
    "frames": {"types"},
    "errors": set(),
    "stopwatch": set(),
    "protocols": {"types"},
    "scene": _BASE,
    "sim": _BASE | {"scene"},
    "mapping": _BASE,
    "planning": _BASE,
    "control": _BASE,
    "io": _BASE,
    "evaluation": _BASE | {"io"},
    "viz": _BASE | {"io"},
    # Composes the stages' configurations, which stand beside their stages.
    "config": _BASE | _STAGES | _READERS,
    # Builds the robot that explore drives out of simulator, camera and drive.
    "robots": _BASE | {"config", "scene", "sim", "control"},
    # Sees recorder, viewer and evaluation only through the protocols.
    "explore": _BASE | _STAGES | {"config", "robots"},
    "doctor": _BASE | {"sim"},
    "cli": _EVERYTHING | {"doctor"},
}
"""What each module or folder of the package may import from the package, beside itself."""

_ONLY_IN = {
    "mujoco": {"scene", "sim", "control", "robots"},
    "dm_control": {"sim"},
    "mink": {"control"},
    "pinocchio": {"control"},
    "torch": {"mapping"},
    "meshcat": {"viz"},
}
"""Heavy packages and the only places that may import them. Elsewhere not even inside a function."""

_MUST_LOAD_WITHOUT = {
    "anm_mj.planning": ("mujoco", "torch"),
    "anm_mj.evaluation": ("mujoco", "torch"),
    "anm_mj.io": ("mujoco", "torch"),
    "anm_mj.viz": ("mujoco", "torch"),
    "anm_mj.mapping": ("mujoco",),
    "anm_mj.sim.gl": ("mujoco", "torch"),
}


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


def violations(source: str, place: str) -> list[str]:
    """What a module in ``place`` (the first part of its name below anm_mj) imports and may not."""
    found = []
    for line, name in imported_modules(source):
        parts = name.split(".")
        if parts[0] == "anm_mj" and len(parts) > 1:
            if parts[1] != place and parts[1] not in _MAY_IMPORT[place]:
                found.append(f"line {line}: {place} may not import {name}")
        elif place not in _ONLY_IN.get(parts[0], {place}):
            found.append(f"line {line}: {parts[0]} belongs to {sorted(_ONLY_IN[parts[0]])}, not to {place}")
    return found


def _place(path: Path) -> str:
    return path.relative_to(_PACKAGE).parts[0].removesuffix(".py")


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


@pytest.mark.parametrize("module", sorted(_MUST_LOAD_WITHOUT))
def test_light_parts_load_without_heavy_packages(module: str):
    folder = _PACKAGE / "/".join(module.split(".")[1:])
    modules = [module, *(f"{module}.{path.stem}" for path in folder.glob("[a-z]*.py"))]
    program = f"import {', '.join(modules)}, sys; print(*set({_MUST_LOAD_WITHOUT[module]!r}) & set(sys.modules))"

    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

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
    ],
)
def test_a_planted_arrow_is_found(source: str, place: str):
    assert len(violations(source, place)) == 1


@pytest.mark.parametrize(
    ("source", "place"),
    [
        ("from anm_mj.types import Plan\nimport numpy, scipy", "planning"),
        ("from anm_mj.planning import gvg", "planning"),
        ("import mujoco\nfrom anm_mj.scene.writer import Scene", "sim"),
        ("import torch", "mapping"),
    ],
)
def test_an_allowed_import_passes(source: str, place: str):
    assert violations(source, place) == []
