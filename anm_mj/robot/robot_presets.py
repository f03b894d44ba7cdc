"""Robots by name: their files, and the settings that these need (``models/presets.toml``). Loads no simulator."""

import fnmatch
import functools
import importlib
import logging
import os
import re
import tomllib
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from anm_mj.errors import RobotError
from anm_mj.robot.robot_config import RobotConfig
from anm_mj.utils.close_names import close_name
from anm_mj.utils.package_data import data_folder
from anm_mj.utils.read_file import read_bytes

_logger = logging.getLogger(__name__)

MODELS = data_folder("models")
FOLDERS_VARIABLE = "ANM_MJ_ROBOTS"
"""Environment variable with folders that hold downloaded robots."""
_MOST_LETTERS = 120
"""Longer words of git are not quoted."""
_NAMES_ELEMENT = ("keyframe", "camera", "left_wheel", "right_wheel")
"""Settings that name an element of the file."""


@dataclass(frozen=True)
class RobotPreset:
    """A robot of this package that others have files of, too."""

    name: str
    source: str
    """Where the maker's file is to be had."""
    description: str = ""
    """Its module in the package robot_descriptions; empty = it is not there."""
    files: tuple[str, ...] = ()
    """Patterns of its file's name."""
    aliases: tuple[str, ...] = ()
    model: dict[str, Any] = field(default_factory=dict)
    """Fields of ``RobotConfig``."""


@functools.cache
def robot_presets() -> dict[str, RobotPreset]:
    """All presets, by name. Raises RobotError if ``models/presets.toml`` cannot be read."""
    path = MODELS / "presets.toml"
    try:
        entries = tomllib.loads(path.read_text(encoding="utf-8"))
        return {
            name: RobotPreset(
                name=name, **entry | {key: tuple(entry[key]) for key in ("files", "aliases") if key in entry}
            )
            for name, entry in entries.items()
        }
    except (OSError, ValueError, TypeError) as err:
        raise RobotError(f"{path} cannot be read ({err}); restore it from the repository.") from err


def preset_config(robot: str) -> RobotConfig:
    """The settings of a robot by its name, or by the name of its file; the defaults where no preset fits."""
    named = _preset(robot)
    preset = named or next((one for one in robot_presets().values() if robot == one.description), None)
    file = Path(robot)
    if preset is None and file.suffix:
        preset = next((p for p in robot_presets().values() if _matches(file, p)), None)
    if preset is None:
        return RobotConfig()
    values = dict(preset.model)
    # Unlike Path.is_file, os.path.isfile raises no error.
    there = file if os.path.isfile(file) else _in_folders(named) if named else None
    if there is not None:
        text = _text(there)
        for key in [k for k in _NAMES_ELEMENT if k in values and f'"{values[k]}"' not in text]:
            _logger.info('%s has no "%s", so model.%s of preset %s is left out', robot, values[key], key, preset.name)
            del values[key]
        if values:
            shown = ", ".join(f"model.{key}={value}" for key, value in values.items())
            _logger.info("settings of the preset %s for %s: %s", preset.name, there.name, shown)
    return RobotConfig(**values)


def robot_path(name_or_file: str) -> Path:
    """The MJCF file of a robot, by its path or by name.

    A named robot is looked for in the folders of ``ANM_MJ_ROBOTS``, then among those of this package, then fetched by
    the package robot_descriptions. Raises RobotError if there is none, with what to install or to give.
    """
    preset = _preset(name_or_file)
    name = preset.name if preset else name_or_file
    builtin = MODELS / name / f"{name}.xml"
    is_name = Path(name_or_file).name == name_or_file and not Path(name_or_file).suffix
    if is_name and os.path.isfile(builtin):
        return (_in_folders(preset) if preset else None) or builtin
    path = Path(name_or_file)
    if os.path.isfile(path):
        return path
    if os.path.isdir(path):
        raise RobotError(f"{name_or_file} is a folder; give the robot's MJCF file in it, as --robot {path}/NAME.xml.")
    if not is_name:
        raise RobotError(f"There is no robot file {name_or_file}; give an MJCF file or a name: {_known()}.")
    return _fetched(name_or_file)


def _preset(name: str) -> RobotPreset | None:
    return next((p for p in robot_presets().values() if name == p.name or name in p.aliases), None)


def _matches(file: Path, preset: RobotPreset) -> bool:
    return any(fnmatch.fnmatch(file.name.lower(), pattern) for pattern in preset.files)


def _known() -> str:
    builtin = sorted(folder.name for folder in MODELS.iterdir() if folder.is_dir())
    return ", ".join(builtin)


def robot_folders() -> list[Path]:
    """The user's folders with downloaded robots."""
    return [Path(folder).expanduser() for folder in os.environ.get(FOLDERS_VARIABLE, "").split(os.pathsep) if folder]


def _in_folders(preset: RobotPreset) -> Path | None:
    """The file of a robot in the user's folders: of files of other robots, too, as stretch.xml, the one whose path says
    most of its name; then the one with the shortest path.
    """
    names = (preset.name, *preset.aliases)

    def rank(found: tuple[Path, Path]) -> tuple[int, int, int, str]:
        folder, file = found
        below = file.relative_to(folder).as_posix().lower()
        return -max(len(name) * (name in below) for name in names), len(file.name), len(str(file)), str(file)

    found = [(folder, file) for folder in robot_folders() for file in folder.rglob("*.xml") if _matches(file, preset)]
    return min(found, key=rank)[1] if found else None


def _fetched(name: str) -> Path:
    by_hand = f"give an MJCF file or a name: {_known()}"
    try:
        known = importlib.import_module("robot_descriptions").DESCRIPTIONS
    except ImportError as err:
        raise RobotError(
            f"There is no robot file {name}, and names of the package robot_descriptions, which is not installed, are "
            f"not known: pip install 'anm-mj[robots]', or {by_hand}."
        ) from err
    module = next((n for n in (name, f"{name}_mj_description") if n in known), "")
    if module not in known:
        hint = close_name(name, _known().split(", "))
        raise RobotError(
            f"There is no robot file {name}{hint}, and robot_descriptions has none of that name; {by_hand}."
        )
    _logger.info("robot_descriptions fetches %s, unless it has it already", module)
    try:
        # git's progress would run through the messages of this program.
        with open(os.devnull, "w", encoding="utf-8") as sink, redirect_stdout(sink), redirect_stderr(sink):
            path = getattr(importlib.import_module(f"robot_descriptions.{module}"), "MJCF_PATH", "")
    except Exception as err:  # The package passes on whatever git and the network raise.
        what = f"The package robot_descriptions could not fetch {module} ({_reason(err)})"
        raise RobotError(f"{what}; check the network, or {by_hand}.") from err
    if not path or not Path(path).is_file():
        raise RobotError(f"{module} of robot_descriptions has no MJCF file; {by_hand}.")
    return Path(path)


def _reason(err: Exception) -> str:
    """What went wrong while git or the network fetched something, without git's commands and progress."""
    text = " ".join(str(err).split())
    host = re.search(r"resolve (?:host|hostname|proxy):? '?([\w.-]+)", text)
    if host:
        return f"{host[1]} cannot be reached"
    fatal = re.findall(r"(?:fatal|error): (.+?)(?=\s+(?:fatal|error): |$)", text)
    said = (fatal[-1] if fatal else text).strip(" '\".")
    return said if 0 < len(said) <= _MOST_LETTERS else f"{type(err).__name__} of its download"


def _text(file: Path, depth: int = 3) -> str:
    try:
        text = read_bytes(file).decode("utf-8", errors="replace")
    except (OSError, ValueError):
        return ""
    if depth:
        for name in re.findall(r'<include\s+file="([^"]+)"', text):
            text += _text(file.parent / name, depth - 1)
    return text
