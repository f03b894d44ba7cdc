"""Writes docs/reference.md and docs/commands.md from the code.

    python scripts/make_reference.py

The first page holds all settings, metrics, keys of a comparison, and what a policy is given; the text of each field is
the docstring below it in its dataclass. The second holds every command with its options, as ``--help`` prints them. A
test compares both with the code.
"""

import ast
import inspect
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any

from anm_mj.bench.sweep import Sweep
from anm_mj.cli import command_line
from anm_mj.cli.main import COMMANDS, PROGRAM
from anm_mj.config import make_config
from anm_mj.environments.environment_config import EnvironmentConfig
from anm_mj.evaluation.metrics import Metrics
from anm_mj.evaluation.trajectory_error import TrajectoryError
from anm_mj.planning.paths import ShortestPathTree
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import policies, policy_class
from anm_mj.planning.stages import PlanningState, Stages
from anm_mj.protocols import Mapper, Policy
from anm_mj.ros.drive_config import RosConfig
from anm_mj.types import (
    Footprint,
    Intrinsics,
    Observation,
    OccupancyGrid,
    Plan,
    Pose2,
    StopReason,
    SurfacePoints,
    TopDownMap,
    VoronoiGraph,
)
from anm_mj.utils.docstrings import field_texts, parameter_texts
from anm_mj.utils.markdown import table
from anm_mj.utils.settings import Settings, limits_of

DOCS = Path(__file__).resolve().parents[1] / "docs"
HEAD = """# Settings, metrics, keys

Made from the code by `python scripts/make_reference.py`; edit the docstrings, not this page. Words, units and files are
defined in [conventions.md](conventions.md).
"""


SETTINGS_HEAD = """## Settings

Given with `--set NAME=VALUE`, but for the fields of a run and `sensor.name`; `config.json` of a run holds all. Numbers
are above zero and at most a million where the range names nothing else; those of `model.*` and `camera.*` are checked
with the robot.
"""
REPEATED = (
    ("aligned_observed_", "", "Of the observed surface, after the alignment of the trajectory"),
    ("observed_", "", "Of the observed surface"),
    ("fixed_view_", "novel_view_", "Mean over the fixed views"),
)
"""How names of metrics begin that repeat others: instead of what, and on what."""
GROUP = ("This and the next", "As the next")
"""How the text of the first metric of such a group begins."""
HEAD_OF_TYPES = ("name", "default or type", "meaning")
HEAD_OF_SETTINGS = ("name", "default", "range", "meaning")

COMMANDS_HEAD = """# Commands

Made from the code by `python scripts/make_reference.py`; it is what `--help` prints. Of every command, `-v` or
`--verbose` shows details, and `-q` or `--quiet` prints only warnings and errors. Exit status and `--json`: [in
scripts](start.md#in-scripts).
"""


VARIABLES = (
    ("`ANM_MJ_SCENES`", "folder of your scenes; else `~/.local/share/anm_mj/scenes`, or that of `XDG_DATA_HOME`"),
    ("`ANM_MJ_ROBOTS`", "folders of robots, with `:` between them; `--robot` takes their names"),
    ("`ANM_MJ_MAX_...`", "limits of what a file may ask for: [bad_input.md](bad_input.md#limits) lists them"),
    (
        "`MUJOCO_GL`",
        "how images are rendered: `egl`, `osmesa` or `glfw`; `off`: by ray casting; else the first that works",
    ),
    (
        "`MUJOCO_EGL_DEVICE_ID`",
        "the [EGL device](camera.md) that draws, by its number in `doctor`; else the first",
    ),
    ("`OMP_NUM_THREADS`", "threads of training and planning, 256 at most; else as many as there are cores"),
    ("`ROS_DOMAIN_ID`, `CYCLONEDDS_URI`", "domain and network of ROS 2: [ros.md](ros.md)"),
    ("`RAY_ADDRESS`", "the Ray cluster of `--executor ray`"),
    ("`UV_TORCH_BACKEND`", "which build of torch `make setup` installs: [start.md](start.md#install)"),
    ("`XDG_CACHE_HOME`", "where compiled models and samples of true surfaces are kept; else `~/.cache`"),
)
"""Environment variables of the program, and what they say."""


def main() -> None:
    """Write the pages."""
    for name, text in pages().items():
        (DOCS / name).write_text(text, encoding="utf-8")


def pages() -> dict[str, str]:
    """The pages by the names of their files."""
    return {"reference.md": reference(), "commands.md": commands()}


def commands() -> str:
    """Every command with its options, but for those that all have."""
    parts = [COMMANDS_HEAD]
    for name, command in command_line.commands(PROGRAM, COMMANDS):
        summary, more, _ = parameter_texts(command)
        known = command_line.arguments(command)
        rows = [(f"`{' '.join(filter(None, (one.flag, one.metavar)))}`", one.help) for one in known]
        if "json" in command_line.manner_options(command):
            rows.append(("`--json`", command_line.MANNER["json"]))
        texts = [f"{summary} {more}".rstrip(), *([_table(rows, ("argument", "meaning"))] if rows else [""])]
        parts.append(f"## `{name}`\n\n" + "\n\n".join(texts).rstrip() + "\n")
    parts.append(
        "## Environment variables\n\nThose that name data sets and models: [scenes.md](scenes.md).\n\n"
        + _table(list(VARIABLES), ("variable", "meaning"))
    )
    return "\n".join(parts)


def reference() -> str:
    """Settings, metrics, keys, and what a policy is given."""
    config = make_config("default", [], scene="home")
    names = "planning", "mapping", "localisation", "people", "model", "camera", "sensor", "record", "checkpoint"
    groups = [name for name in names if is_dataclass(getattr(config, name))]
    parts = [HEAD, SETTINGS_HEAD]
    about = "Given by options of their own; `image_px` by `--set`."
    run = [(name, default, meaning) for name, default, _, meaning in _rows(config, "", nested=False)]
    parts.append(_section("Run", about, run))
    parts += [_settings(f"`{group}.*`", "", getattr(config, group), f"{group}.") for group in groups]
    parts.append(_settings("`ros.*`", "Of `anm-mj drive`: [ros.md](ros.md).", RosConfig(), "ros."))
    known: dict[type, list[str]] = {}
    for name in policies():
        known.setdefault(getattr(policy_class(name), "Config", object), []).append(name)
    for settings, names in known.items():
        if is_dataclass(settings) and fields(settings):
            title = f"`policy.*` of {', '.join(f'`{name}`' for name in names)}"
            parts.append(_settings(title, "", settings(), "policy."))
    parts.append("## Metrics\n\nFields of `metrics.json`; `null` where unknown.\n\n" + _table(_metrics()))
    reasons = [(f"`{name}`", text) for name, text in field_texts(StopReason).items()]
    parts.append("## Stop reasons\n\n`stop_reason` of `metrics.json`.\n\n" + _table(reasons, ("name", "meaning")))
    rows = [(f"`{entry.name}`", _default(entry), texts) for entry, texts in _documented(Sweep)]
    text = (
        "Of the TOML file of `anm-mj bench`, at its head or below `[[sweep]]`. Beside them stand `suite`, "
        "`[[generated]]` and `[[imported]]`: [benchmarks.md](benchmarks.md#a-comparison-of-your-own)."
    )
    parts.append(f"## Keys of a comparison\n\n{text}\n\n{_table(rows)}")
    rows = [(f"`{entry.name}`", _default(entry), text) for entry, text in _documented(EnvironmentConfig)]
    parts.append("## Options of an environment\n\n" + _table(rows))
    parts.append("## What a policy is given, and what it returns\n")
    parts += [_section(f"`{one.__name__}`", _summary(one), _plain(one)) for one in (PolicyContext, Plan, Observation)]
    parts += [_section(f"`{one.__name__}`", _summary(one), _methods(one)) for one in (Policy, Mapper, Stages)]
    rows = _plain(ShortestPathTree) + _methods(ShortestPathTree)
    parts.append(_section("`PlanningState`", _summary(PlanningState), _plain(PlanningState)))
    parts.append(_section("`ShortestPathTree`", _summary(ShortestPathTree), rows))
    others = (Footprint, Intrinsics, Pose2, OccupancyGrid, SurfacePoints, TopDownMap, VoronoiGraph)
    parts += [_section(f"`{one.__name__}`", _summary(one), _plain(one)) for one in others]
    return "\n".join(parts)


def _section(title: str, text: str, rows: Sequence[tuple[str, ...]], head: tuple[str, ...] = HEAD_OF_TYPES) -> str:
    return f"### {title}\n\n" + (f"{text}\n\n" if text else "") + _table(rows, head)


def _settings(title: str, text: str, config: Any, prefix: str) -> str:
    """The settings below a configuration."""
    return _section(title, text, _rows(config, prefix), HEAD_OF_SETTINGS)


def _table(rows: Sequence[tuple[str, ...]], head: tuple[str, ...] = HEAD_OF_TYPES) -> str:
    return table(head, rows, text_columns=range(len(head))) + "\n"


def _rows(config: Any, prefix: str, *, nested: bool = True) -> list[tuple[str, str, str, str]]:
    """Name, default, range and meaning of every setting below a configuration."""
    rows = []
    for entry, text in _documented(type(config)):
        value = getattr(config, entry.name)
        if is_dataclass(value):
            rows += _rows(value, f"{prefix}{entry.name}.") if nested else []
        elif nested or entry.name != "policy_settings":
            allowed = limits_of(config, entry.name).text if isinstance(config, Settings) else ""
            rows.append((f"`{prefix}{entry.name}`", f"`{value!r}`" if value is not None else "", allowed, text))
    return rows


def _plain(one: type) -> list[tuple[str, str, str]]:
    """Name, type as it is written, and meaning of every field of a dataclass."""
    written = {
        node.target.id: ast.unparse(node.annotation)
        for base in reversed(one.__mro__)
        if is_dataclass(base)
        for node in _class_node(base).body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }
    return [(f"`{entry.name}`", f"`{_type_name(written[entry.name])}`", text) for entry, text in _documented(one)]


def _metrics() -> list[tuple[str, str, str]]:
    """The fields of ``metrics.json``; one without a text of its own has that of what it repeats."""
    rows = _plain(Metrics)
    known = {name.strip("`"): text for name, _, text in (*rows, *_plain(TrajectoryError)) if text}
    return [
        (name, kind, text if text and not text.startswith(GROUP) else _repeated(name.strip("`"), known))
        for name, kind, text in rows
    ]


def _repeated(name: str, known: Mapping[str, str]) -> str:
    """The text of a metric that has none of its own."""
    for start, instead, where in REPEATED:
        if name.startswith(start):
            text = known[instead + name.removeprefix(start)]
            return f"{where}: {text[0].lower() if text[1].islower() else text[0]}{text[1:]}"
    return known[name]


def _methods(protocol: type) -> list[tuple[str, str, str]]:
    """Name, signature and meaning of every method and property of a protocol."""
    rows = []
    for node in _class_node(protocol).body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            arguments = ast.unparse(node.args).removeprefix("self, ").removeprefix("self")
            call = "" if node.decorator_list else f"({arguments})"
            result = f" -> {ast.unparse(node.returns)}" if node.returns else ""
            rows.append(
                (
                    f"`{node.name}`",
                    f"`{_type_name(call + result)}`",
                    _flat((ast.get_docstring(node) or "").partition("\n\nArgs:")[0]),
                )
            )
    return rows


def _documented(one: type) -> list[tuple[Any, str]]:
    """The fields of a dataclass, each with the docstring below it."""
    texts = field_texts(one)
    return [(entry, _flat(texts.get(entry.name, ""))) for entry in fields(one)]


def _class_node(one: type) -> ast.ClassDef:
    node = ast.parse(textwrap.dedent(inspect.getsource(one))).body[0]
    assert isinstance(node, ast.ClassDef)
    return node


def _default(entry: Any) -> str:
    return "" if entry.default in (MISSING, None) else f"`{entry.default!r}`"


def _summary(one: type) -> str:
    return _flat((inspect.getdoc(one) or "").split("\n\n")[0])


def _type_name(annotation: str) -> str:
    return annotation.replace("np.", "numpy.").replace("'", "")


def _flat(text: str) -> str:
    """One line of Markdown for a docstring."""
    one = " ".join(text.split()).replace("``", "`")
    for role in (":class:`", ":func:`", ":mod:`", ":data:`", ":meth:`"):
        one = one.replace(f"{role}~", "`").replace(role, "`")
    return one


if __name__ == "__main__":
    main()
