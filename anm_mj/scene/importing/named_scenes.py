"""Scenes of published data sets by name, such as ``molmospaces:procthor-10k-val/12``, in folders that the user has.

Nothing is downloaded from here; where the data set's own package is installed, it is asked to fetch what is missing.
"""

import importlib
import importlib.util
import logging
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from anm_mj.errors import SceneError
from anm_mj.utils.files import cache_folder, write_text

_logger = logging.getLogger(__name__)

_MOLMO_HELP = (
    "install the package molmo-spaces (pip install molmo-spaces), which fetches scenes, or download the set from "
    "huggingface.co/datasets/allenai/molmospaces and give its folder with --root or in MLSPACES_ASSETS_DIR"
)
_ROBOCASA_HELP = (
    "RoboCasa composes its kitchens in Python: install robosuite and robocasa with its assets and name one "
    "as in robocasa:layout1_style2, or write the XML of a made kitchen (env.sim.model.get_xml()) to NAME.xml in a "
    "folder, and give that with --root or in ROBOCASA_SCENES"
)
_KITCHEN = re.compile(r"layout_?(\d+)_style_?(\d+)")
_REPLICACAD_HELP = (
    "download it with `python -m habitat_sim.utils.datasets_download --uids replica_cad_dataset --data-path data`, and "
    "give its folder with --root or in REPLICA_CAD_ROOT, or stay in the folder that holds data/"
)


@dataclass(frozen=True)
class NamedSource:
    """A scene of a data set on the disk."""

    path: Path
    source_format: str
    source: str
    licence: str
    groups: tuple[int, ...] | None = None
    """Geom groups that are drawn, where the set does not follow MuJoCo's habit."""
    folders: tuple[Path, ...] = ()
    """Where an MJCF file of the set may name files."""


@dataclass(frozen=True)
class _DataSet:
    title: str
    example: str
    licence: str
    source_format: str
    variables: tuple[str, ...]
    usual: tuple[str, ...]
    """Folders where it lies by default."""
    files: Callable[[str], list[str]]
    """Patterns below its folder that a name may stand for, the best first."""
    help: str
    make: Callable[[str], Path | None] | None = None
    """Asks the data set's own package for a scene that is not on the disk; None where the package is not installed."""
    groups: tuple[int, ...] | None = None
    packages: tuple[str, ...] = ()
    """Packages whose files its scenes name."""


def _molmospaces_files(name: str) -> list[str]:
    """Houses are scenes/SET/SPLIT_NUMBER.xml, with and without a ceiling; rooms of iTHOR FloorPlanN_physics.xml."""
    dataset, _, number = name.rpartition("/")
    if not dataset:
        return []
    stem = re.sub(r"-(train|val|test)$", "", dataset)
    split = dataset.removeprefix(stem).strip("-")
    words = [f"{split}_{number}", f"FloorPlan{number}", number] if split else [f"FloorPlan{number}", number]
    names = [f"{word}{end}.xml" for word in words for end in ("_ceiling", "_physics", "")]
    folders = [f"scenes/{own}{below}" for own in dict.fromkeys((dataset, stem)) for below in ("", "/*")]
    return [f"{folder}/{own}" for own in names for folder in (*folders, *(f[len("scenes/") :] for f in folders))]


def is_name(src: str | Path) -> bool:
    """Whether a source is the name of a scene in a data set."""
    return str(src).partition(":")[0] in _SETS and ":" in str(src)


def find_named(src: str | Path, root: Path | None = None) -> NamedSource:
    """The scene of a name, below ``root`` or in the folder that the data set's environment variable names. Raises
    SceneError if it is not on the disk and its package cannot fetch it.
    """
    prefix, _, name = str(src).partition(":")
    data, name = _SETS[prefix], name.strip("/")
    if not name or ".." in name.split("/"):
        raise SceneError(f"{src} names no scene of {data.title}: give one as in {prefix}:{data.example}.")
    if root is not None and not os.path.isdir(root):
        raise SceneError(f"{root} is not a folder: give the folder of {data.title} with --root.")
    folders = [root] if root is not None else _folders(data)
    found = _first(folders, data.files(name))
    if found is None and root is None and data.make is not None:
        found = data.make(name)
    if found is None:
        where = ", ".join(map(str, folders)) or "no folder given"
        raise SceneError(f"{data.title} has no scene {name!r} here ({where}): {data.help}.")
    _logger.info("%s is %s", src, found)
    own = (*folders, *_package_folders(data.packages)) if data.source_format == "mjcf" else ()
    return NamedSource(found, data.source_format, f"{data.title}, {name}", data.licence, data.groups, own)


def _folders(data: _DataSet) -> list[Path]:
    stated = [Path(os.environ[variable]).expanduser() for variable in data.variables if os.environ.get(variable)]
    usual = [Path(folder).expanduser() for folder in data.usual]
    return [folder for folder in (*stated, *usual) if os.path.isdir(folder)]


def _package_folders(names: Sequence[str]) -> list[Path]:
    found = []
    for name in names:
        try:
            spec = importlib.util.find_spec(name)
        except ValueError:  # A module made by hand.
            continue
        found += [Path(place) for place in (spec and spec.submodule_search_locations) or ()]
    return found


def _first(folders: Sequence[Path], patterns: Sequence[str]) -> Path | None:
    for folder, pattern in product(folders, patterns):
        try:
            matches = sorted(path for path in folder.glob(pattern) if os.path.isfile(path))
        except (OSError, ValueError):  # A name that no file can have.
            continue
        if matches:
            return matches[-1]
    return None


def _fetched(name: str) -> Path | None:
    dataset, _, number = name.rpartition("/")
    split = next((word for word in ("train", "val", "test") if dataset.endswith(f"-{word}")), "train")
    try:
        constants = importlib.import_module("molmo_spaces.molmo_spaces_constants")
        loading = importlib.import_module("molmo_spaces.utils.lazy_loading_utils")
    except ImportError:
        return None
    try:
        path = constants.get_scenes(dataset.removesuffix(f"-{split}"), split)[split][int(number)]
        loading.install_scene_with_objects_and_grasps_from_path(path)
    # A package that fetches from the network raises whatever goes wrong there.
    except Exception as err:
        raise SceneError(
            f"The package molmo-spaces could not fetch {name} ({type(err).__name__}: {err}): {_MOLMO_HELP}."
        ) from err
    return Path(path) if Path(path).is_file() else None


def _composed(name: str) -> Path | None:
    numbers = _KITCHEN.fullmatch(name)
    out = cache_folder("robocasa") / f"{name}.xml"
    if numbers is None or out.is_file():
        return out if numbers else None
    try:
        importlib.import_module("robocasa")
        robosuite = importlib.import_module("robosuite")
    except ImportError:
        return None
    layout, style = (int(number) for number in numbers.groups())
    _logger.info("RoboCasa composes layout %d in style %d; its robot is left out of the scene", layout, style)
    try:
        kitchen = robosuite.make(
            "Kitchen",
            robots="PandaOmron",
            layout_ids=layout,
            style_ids=style,
            seed=0,
            has_renderer=False,
            has_offscreen_renderer=False,
            use_camera_obs=False,
        )
        kitchen.reset()
        text = kitchen.sim.model.get_xml()
    # A package that reads its own downloads raises whatever it misses.
    except Exception as err:
        raise SceneError(
            f"The package robocasa could not compose {name} ({type(err).__name__}: {err}): {_ROBOCASA_HELP}."
        ) from err
    out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, text)
    return out


_SETS = {
    "molmospaces": _DataSet(
        "MolmoSpaces",
        "procthor-10k-val/12",
        "ODC-BY 1.0; objects under their own licences (MolmoSpaces docs/LICENSE.md)",
        "mjcf",
        ("MLSPACES_ASSETS_DIR", "MLSPACES_CACHE_DIR"),
        ("~/.cache/molmo-spaces-resources",),
        _molmospaces_files,
        _MOLMO_HELP,
        _fetched,
    ),
    "robocasa": _DataSet(
        "RoboCasa",
        "layout1_style2",
        "CC BY 4.0",
        "mjcf",
        ("ROBOCASA_SCENES",),
        (),
        lambda name: [f"{name}.xml", f"{name}/scene.xml", f"{name}/model.xml", f"{name}/{name.rpartition('/')[2]}.xml"],
        _ROBOCASA_HELP,
        _composed,
        # Group 0 holds what collides.
        (1, 2),
        ("robocasa", "robosuite"),
    ),
    "replicacad": _DataSet(
        "ReplicaCAD",
        "apt_0",
        "CC BY 4.0",
        "replicacad",
        ("REPLICA_CAD_ROOT",),
        ("data/replica_cad", "data/replica_cad_dataset", "data/versioned_data/replica_cad_dataset"),
        lambda name: [f"{below}configs/scenes/{name}.scene_instance.json" for below in ("", "*/")],
        _REPLICACAD_HELP,
    ),
}
