"""The effective configuration of a run: the options of the command line and the settings of every stage.

A setting has a dotted name, as in ``config.json``: ``planning.margin_m``, ``mapping.schedule.iterations``. The settings
of the chosen policy are called ``policy.NAME``.
"""

import ast
import difflib
import functools
import logging
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, ClassVar, TypeVar

from anm_mj.checkpoint.checkpoint_config import CheckpointConfig
from anm_mj.errors import ConfigError
from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.mapping.mapping_config import DEVICES, MAPPING_PRESETS, MappingConfig
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.registry import DEFAULT_GOAL, DEFAULT_POLICY, GOALS, default_settings, policy_entry
from anm_mj.recording.record_config import RecordConfig
from anm_mj.sim.sensors.sensor_config import SensorConfig, sensor_config
from anm_mj.sim.simulation_config import IDEAL, SimulationConfig, reality_of, require_choice
from anm_mj.utils.settings import of_type

_logger = logging.getLogger(__name__)

BUDGETS = ("scene", "area", "rooms")
PRESETS = tuple(MAPPING_PRESETS)
DEFAULT_PRESET = "default"
MOST_STEPS = 10**9
_MOST_LETTERS = 80
"""Longer values are not quoted whole."""
OPTIONS = {
    "policy": "--policy NAME",
    "goal": "--goal GOAL",
    "steps": "--steps N",
    "budget": "--budget RULE",
    "seed": "--seed S",
    "start": "--start X,Y,YAW_DEG",
    "reality": "--reality WORLD",
    "robot": "--robot ROBOT",
    "drive": "--drive DRIVE",
    "pose": "--pose POSE",
    "device": "--device DEVICE",
    "preset": "--preset PRESET",
    "continue_from": "--continue RUN",
    "unknown_start": "--unknown-start",
    "return_to_start": "--return",
}
"""How the fields of ``RunConfig`` are given that have an option of their own; the scene is the first argument."""
_MOVED = {"planning.geometry": "mapping.geometry"}
"""Settings that stand in another group than they did."""
_MOVERS = tuple(("people", name) for name in ("number", "vacuums", "chair_pushed_s"))
_MOVING = "mapping", "moving", "detect"
_CAMERA, _CAMERA_POSE = ("model", "camera"), ("model", "camera_pose")


@dataclass(frozen=True)
class RunConfig(SimulationConfig):
    """All that decides how a run goes, apart from the scene's content and the versions of the programs."""

    COMMAND: ClassVar[str] = "explore"
    """What of ``anm-mj`` makes such a run, and resumes it."""

    policy: str = DEFAULT_POLICY
    """What decides where to go, by its name or as ``module:Class``."""
    goal: str = DEFAULT_GOAL
    """What the run is for: ``coverage`` (see all surface, then stop), ``reconstruction`` (know it well), or ``both`` in
    this order."""
    steps: int | None = None
    """Budget of discrete actions, turns included; None = by ``budget``."""
    budget: str = "scene"
    """Rule of the budget: ``scene`` (the scene's own, or else by floor), ``area`` (by floor), or ``rooms`` (the
    paper's, by the number of rooms)."""
    device: str = "auto"
    """Where the neural map trains: ``cpu``, ``cuda`` (which cannot localise), or ``auto`` (``cpu``; policy ``anm`` and
    the torch engine take a GPU if there is one)."""
    continue_from: str | None = None
    """Folder of an earlier run: this one begins with its map and explored state, and marks what has changed; None =
    with nothing."""
    unknown_start: bool = False
    """With the map of an earlier run and poses by ``slam``: the robot is not told where it starts, and finds itself in
    that map first. Without a start it stands at a place drawn from the seed."""
    return_to_start: bool = False
    """Drive back to the start before the run ends, in time for the budget."""
    preset: str = DEFAULT_PRESET
    """Mapping effort: ``quick``, ``default`` or ``paper``; some policies have their own."""
    mapping: MappingConfig = field(default_factory=MappingConfig)
    localisation: LocalisationConfig = field(default_factory=LocalisationConfig)
    """Settings of localisation, which ``pose = slam`` asks for."""
    planning: PlanningConfig = field(default_factory=PlanningConfig)
    """Settings of the planning stages that the policies share."""
    record: RecordConfig = field(default_factory=RecordConfig)
    """What the run folder keeps for replay and exports."""
    checkpoint: CheckpointConfig = field(default_factory=CheckpointConfig)
    """How often the state of the run is stored."""
    policy_settings: Any = None
    """Settings of the policy: an instance of its class's ``Config``; None = its defaults."""

    def __post_init__(self) -> None:
        """Fill in the policy's default settings and check the options. Raises ConfigError if a choice is unknown or a
        number out of range, PlanError if there is no such policy, and RobotError if the settings of the named robots
        cannot be read.
        """
        super().__post_init__()
        if self.policy_settings is None:
            object.__setattr__(self, "policy_settings", default_settings(self.policy))
        require_choice("goal", self.goal, GOALS)
        require_choice("budget", self.budget, BUDGETS)
        require_choice("device", self.device, DEVICES)
        require_choice("preset", self.preset, PRESETS)
        if self.unknown_start and (self.continue_from is None or self.pose != "slam"):
            raise ConfigError(
                "--unknown-start needs the map that the robot is to find itself in, and the localisation that finds "
                "it; add --continue RUN and --pose slam."
            )
        if self.steps is not None and self.steps < 1:
            raise ConfigError(f"--steps is {self.steps}; a run needs at least 1 step.")
        if self.steps is not None and self.steps > MOST_STEPS:
            raise ConfigError(f"--steps is {_short(str(self.steps))}; give {MOST_STEPS} steps at most.")


Kind = TypeVar("Kind", bound=RunConfig)


def make_config(
    preset: str,
    settings: list[str],
    *,
    sensor: str | None = None,
    reality: str = IDEAL,
    kind: type[Kind] = RunConfig,
    **options: Any,
) -> Kind:
    """The configuration of a preset with options and single settings laid over it.

    Args:
        preset: a key of ``MAPPING_PRESETS``.
        settings: ``group.name=value`` each, such as ``planning.margin_m=0.06`` or ``policy.tour_depth=6``.
        sensor: a key of :data:`anm_mj.sim.sensors.sensor_config.SENSORS`; None = that of the reality.
        reality: a key of :data:`anm_mj.sim.simulation_config.REALITIES`; its options and settings come first.
        kind: the class of the configuration.
        **options: its fields.

    Raises:
        ConfigError: there is no such preset or setting, or an option or setting cannot have its value.
        PlanError: there is no such policy, or a planning setting is out of range.
        RobotError: there is no such sensor, or a sensor or robot setting is out of range.
    """
    options = {name: _option(kind, name, value) for name, value in {**options, "reality": reality}.items()}
    world = reality_of(options["reality"])
    named: str = _option(SensorConfig, "name", sensor or world.options.get("sensor", "exact"), "sensor")
    options = {**world.options, **options, "sensor": sensor_config(named)}
    config = _default_config(kind, _option(kind, "preset", preset), **options)
    values: dict[tuple[str, ...], Any] = {
        (group, name): value for group, own in world.settings.items() for name, value in own.items()
    }
    for text in settings:
        name, equals, value = text.partition("=")
        if not equals:
            raise ConfigError(f"--set {text} has no '='; write it as group.name=value, as in planning.margin_m=0.06.")
        if name in OPTIONS or name in ("sensor", "sensor.name"):
            option = OPTIONS.get(name, "--sensor").split()[0]
            raise ConfigError(f"--set {name} is not how it is given; use {option} {value}.")
        if name == "scene":
            raise ConfigError(f"--set scene is not how it is given; name the scene first: anm-mj explore {value}.")
        keys = _keys(config, name)
        default = _setting(config, keys)
        if default is None:
            raise ConfigError(f"--set {name}: there is no such setting{_hint(config, name)}")
        values[keys] = _parse(default, value, name)
    # A camera that the user names or mounts takes the place of the preset's.
    for given, other in ((_CAMERA, _CAMERA_POSE), (_CAMERA_POSE, _CAMERA)):
        if values.get(given):
            values.setdefault(other, "")
    # Among people and things that move, the map tells apart what moves.
    if any(values.get(keys) for keys in _MOVERS):
        values.setdefault(_MOVING, True)
    return _with(config, values)


def _option(owner: Any, field: str, value: Any, name: str = "") -> Any:
    """An option as the type of the field that holds it; paths, numbers and arrays of NumPy, too. ``name`` is what it is
    called, if not as the field. Raises ConfigError if there is no such field, or it is of another type or not finite.
    """
    if field not in {entry.name for entry in fields(owner)}:
        raise ConfigError(f"{field} is {value!r}, but there is no such option.")
    plain = os.fspath(value) if isinstance(value, os.PathLike) else value
    try:
        found = of_type(owner, field, plain.tolist() if hasattr(plain, "tolist") else plain)
        if isinstance(found, tuple) and not all(map(math.isfinite, found)):
            raise ValueError("Expected finite numbers")
    except ValueError as err:
        said = str(err).replace("null", "None")
        raise ConfigError(f"{name or field} is {value!r} ({said}); give a value of the right type.") from err
    return found


def read_config(values: Mapping[str, Any], kind: type[Kind] = RunConfig) -> Kind:
    """The configuration, of the class ``kind``, that the content of a run's ``config.json`` says; settings that this
    version does not know are logged. Raises ConfigError if a value is not allowed, and PlanError if there is no such
    policy.
    """
    if "scene" not in values:
        raise ConfigError("config.json names no scene; copy the run again.")
    options = {
        name: _of_type(RunConfig, name, values[name], name)
        for name in ("scene", *OPTIONS, "image_px")
        if name in values
    }
    config = _default_config(kind, options.pop("preset", DEFAULT_PRESET), **options)
    known = {}
    for name, value in leaves(values):
        keys = _keys(config, name)
        if _setting(config, keys) is not None:
            owner = functools.reduce(getattr, keys[:-1], config)
            known[keys] = _of_type(type(owner), keys[-1], value, name)
        elif name not in ("scene", *OPTIONS):
            _logger.info("this version has no setting %s", name)
    return _with(config, known)


def _of_type(owner: type, field: str, value: Any, name: str) -> Any:
    """The value of a setting that a file holds; raises ConfigError for another type than the setting's."""
    try:
        return of_type(owner, field, value)
    except ValueError as err:
        raise ConfigError(f"config.json cannot be used: {name}: {err}; copy the run again.") from err


def _default_config(kind: type[Kind], preset: str, **options: Any) -> Kind:
    """The configuration of a preset, with what the policy needs."""
    require_choice("preset", preset, PRESETS)
    policy = options.get("policy", DEFAULT_POLICY)
    entry = policy_entry(policy)
    if entry.mapping_preset is not None:
        if preset not in (DEFAULT_PRESET, entry.mapping_preset):
            raise ConfigError(
                f"--preset is '{preset}', but policy {policy} has a map of its own kind; leave --preset out."
            )
        preset = entry.mapping_preset
    mapping = MAPPING_PRESETS[preset]()
    if entry.uncertainty_preset is not None:
        mapping = replace(mapping, uncertainty=MAPPING_PRESETS[entry.uncertainty_preset]().uncertainty)
    return kind(preset=preset, mapping=mapping, **options)


def leaves(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted name and value of every setting in nested dictionaries."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _names(node: Any, prefix: str = "") -> Iterator[str]:
    """Dotted names of all settings below a configuration."""
    for entry in fields(node):
        value = getattr(node, entry.name)
        if is_dataclass(value):
            yield from _names(value, f"{'policy' if entry.name == 'policy_settings' else prefix + entry.name}.")
        elif prefix or entry.name not in ("scene", *OPTIONS):
            yield prefix + entry.name


def _keys(config: RunConfig, name: str) -> tuple[str, ...]:
    """The fields that lead to a setting, from its dotted name, or from the one that it had elsewhere."""
    keys = tuple(name.split("."))
    if keys[0] == "policy" and len(keys) > 1:
        keys = ("policy_settings", *keys[1:])
    if name in _MOVED and _setting(config, keys) is None:
        return _keys(config, _MOVED[name])
    return keys


def _setting(config: RunConfig, keys: tuple[str, ...]) -> Any:
    """The value of a setting; None where these fields lead to none."""
    node: Any = config
    for key in keys:
        if not is_dataclass(node) or key not in (entry.name for entry in fields(node)):
            return None
        node = getattr(node, key)
    return None if is_dataclass(node) else node


def _hint(config: RunConfig, name: str) -> str:
    """What to write instead of an unknown name: settings with a name that is close, or all of its group."""
    names = list(_names(config))
    if any(full.startswith(f"{name}.") for full in names):
        return f"; there are {', '.join(full for full in names if full.startswith(f'{name}.'))}."
    leaf = {full: full.rpartition(".")[2] for full in names}
    # One wrong letter in the group, and the rest right: nothing else was meant.
    if whole := difflib.get_close_matches(name, names, n=1, cutoff=0.9):
        return f"; did you mean {whole[0]}?"
    close = difflib.get_close_matches(name.rpartition(".")[2], set(leaf.values()), n=3)
    found = [full for one in close for full in names if leaf[full] == one]
    if found:
        return f"; did you mean {' or '.join(found)}?"
    group = name.partition(".")[0] + "."
    if of_group := [full for full in names if full.startswith(group)]:
        return f"; there are {', '.join(of_group)}."
    return "; docs/reference.md and config.json of any run list all."


def _with(node: Any, values: Mapping[tuple[str, ...], Any]) -> Any:
    """A copy of a nested dataclass with other leaves, replaced all at once because limits may depend on one another."""
    parts = {}
    for key in dict.fromkeys(keys[0] for keys in values):
        inner = {keys[1:]: value for keys, value in values.items() if keys[0] == key}
        parts[key] = inner[()] if () in inner else _with(getattr(node, key), inner)
    return replace(node, **parts)


def _parse(default: Any, text: str, name: str) -> Any:
    """The value that a text stands for, of the type of the setting's default."""
    if isinstance(default, str):
        return text
    try:
        # Shells and JSON write booleans in lower case.
        value = ast.literal_eval(text.capitalize() if isinstance(default, bool) else text)
        if isinstance(default, float) and type(value) is int:
            value = float(value)
    except (ValueError, SyntaxError, OverflowError, RecursionError, MemoryError):  # Of text nested too deeply.
        value = None
    if not _is_like(value, default):
        shown = _short(text)
        raise ConfigError(f"--set {name}={shown}: '{shown}' is not of type {type(default).__name__}, like {default}.")
    return value


def _short(text: str) -> str:
    """A text, or its beginning where it is long."""
    return text if len(text) <= _MOST_LETTERS else f"{text[:_MOST_LETTERS]}..."


def _is_like(new: Any, old: Any) -> bool:
    if isinstance(new, float) and not math.isfinite(new):
        return False
    if isinstance(old, tuple) and isinstance(new, tuple):
        return len(new) == len(old) and all(
            _is_like(n, o) or (type(n) is int and type(o) is float) for n, o in zip(new, old, strict=True)
        )
    return type(new) is type(old)
