"""The effective configuration of a run: what the command line gave, and every stage's settings."""

from __future__ import annotations

import ast
import math
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

from anm_mj.errors import AnmError
from anm_mj.mapping.config import MAPPING_PRESETS, MappingConfig
from anm_mj.planning.config import PlanningConfig
from anm_mj.robot.config import DEFAULT_ROBOT, RobotConfig

DRIVES = ("kinematic", "physics")
POSES = ("true", "odometry")
DEVICES = ("auto", "cpu", "cuda")
PRESETS = tuple(MAPPING_PRESETS)
OPTIONS = ("policy", "steps", "seed", "start", "robot", "drive", "pose", "device", "preset")
"""Fields of ``RunConfig`` with an option of their own; the scene is the first argument."""
SMALL_SCENE_ROOMS = 5
"""Scenes up to this many rooms get 1000 steps, larger ones 2000, from 20 rooms on 10,000 (the paper's budgets)."""


class ConfigError(AnmError):
    """An option has a value that it cannot have."""


@dataclass(frozen=True)
class RunConfig:
    """All that decides how a run goes, apart from the scene's content and the versions of what runs it."""

    scene: str
    """Name from the catalogue, or path of a scene folder."""
    policy: str = "gvg"
    """Name of a policy, or ``module:Class``."""
    steps: int | None = None
    """Budget of discrete actions; None = the scene's own."""
    seed: int = 0
    """Seed of everything random: training, policy, evaluation samples."""
    start: tuple[float, float, float] | None = None
    """Start pose x [m], y [m], yaw [deg]; None = the scene's first."""
    robot: str = DEFAULT_ROBOT
    """One of our own robots by its name, or an MJCF file."""
    drive: str = "kinematic"
    """How actions are executed: ``kinematic`` (exactly) or ``physics`` (wheel torque and contact)."""
    pose: str = "true"
    """Where observations are said to be made: at the ``true`` pose, or where wheel ``odometry`` has the robot."""
    device: str = "auto"
    """Where the neural map is trained: ``cpu``, ``cuda``, or ``auto`` = the GPU if there is one."""
    preset: str = "default"
    """Name of the mapping preset that ``mapping`` was made from."""
    image_px: int = 256
    """Width and height of the camera image [px]."""
    model: RobotConfig = field(default_factory=RobotConfig)
    """What the robot's parts are called, and how good its encoders are."""
    mapping: MappingConfig = field(default_factory=MappingConfig)
    planning: PlanningConfig = field(default_factory=PlanningConfig)

    def __post_init__(self) -> None:
        """Refuse what cannot be run.

        Raises:
            ConfigError: a choice is unknown or a number out of range.
        """
        _require_choice("--drive", self.drive, DRIVES)
        _require_choice("--pose", self.pose, POSES)
        _require_choice("--device", self.device, DEVICES)
        _require_choice("--preset", self.preset, PRESETS)
        if self.steps is not None and self.steps < 1:
            raise ConfigError(f"--steps is {self.steps}; a run needs at least 1 step.")
        if self.seed < 0:
            raise ConfigError(f"--seed is {self.seed}; give a whole number from 0 up.")
        if not 16 <= self.image_px <= 2048:
            raise ConfigError(f"image_px is {self.image_px}; it must lie between 16 and 2048.")


def make_config(preset: str, settings: list[str], **options: Any) -> RunConfig:
    """The configuration of a preset with options and single settings laid over it.

    Args:
        preset: a key of ``MAPPING_PRESETS``.
        settings: ``stage.name=value`` each, such as ``planning.margin_m=0.06``.
        **options: fields of ``RunConfig``.

    Raises:
        ConfigError: the preset, a setting's name or a value is not one there is.
    """
    _require_choice("--preset", preset, PRESETS)
    if options.get("policy") == "anm":
        if preset not in ("default", "anm"):
            raise ConfigError(f"--preset is '{preset}', but policy anm has a map of its own kind; leave --preset out.")
        preset = "anm"
    mapping = MAPPING_PRESETS[preset]()
    if options.get("policy") == "anm-s":  # The paper's policy is led by the paper's uncertainty, whatever the preset.
        mapping = replace(mapping, uncertainty=MAPPING_PRESETS["paper"]().uncertainty)
    config = RunConfig(preset=preset, mapping=mapping, **options)
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals:
            raise ConfigError(
                f"--set {setting} has no '='; write it as stage.name=value, as in planning.margin_m=0.06."
            )
        if name in OPTIONS:
            raise ConfigError(f"--set {name} is not how it is given; use --{name} {value}.")
        config = _with(config, name.split("."), value, name)
    return config


def default_steps(rooms: int | None) -> int:
    """The paper's budget for a scene of this many rooms [steps]."""
    if rooms is None or rooms <= SMALL_SCENE_ROOMS:
        return 1000
    return 2000 if rooms < 20 else 10_000


def _require_choice(option: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise ConfigError(f"{option} is '{value}'; it must be one of {', '.join(choices)}.")


def _with(node: Any, keys: list[str], value: str, full_name: str) -> Any:
    """A copy of a nested dataclass with one leaf replaced."""
    names = [f.name for f in fields(node)]
    if keys[0] not in names:
        raise ConfigError(f"--set {full_name}: there is no '{keys[0]}'; there are {', '.join(names)}.")
    old = getattr(node, keys[0])
    if is_dataclass(old) and len(keys) > 1:
        return replace(node, **{keys[0]: _with(old, keys[1:], value, full_name)})
    if is_dataclass(old) or len(keys) > 1:
        raise ConfigError(f"--set {full_name} does not name a single setting.")
    return replace(node, **{keys[0]: _like(old, value, full_name)})


def _like(old: Any, value: str, full_name: str) -> Any:
    """``value`` as the type of ``old``."""
    if isinstance(old, str):
        return value
    try:
        new = ast.literal_eval(value)
    except (ValueError, SyntaxError):
        new = None
    if isinstance(old, float) and isinstance(new, int) and not isinstance(new, bool):
        new = float(new)
    if not _is_like(new, old):
        raise ConfigError(f"--set {full_name}={value}: '{value}' is not of type {type(old).__name__}, like {old}.")
    return new


def _is_like(new: Any, old: Any) -> bool:
    if isinstance(new, float) and not math.isfinite(new):
        return False
    if isinstance(old, tuple) and isinstance(new, tuple):
        return len(new) == len(old) and all(
            _is_like(n, o) or (type(n) is int and type(o) is float) for n, o in zip(new, old, strict=True)
        )
    return type(new) is type(old)
