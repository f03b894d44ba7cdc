"""Reads MJCF that anybody may have written: what it asks for is counted before MuJoCo makes it.

MuJoCo copies elements while it reads a file, in time that grows with the square of their number, and it opens whatever
files are named, a FIFO as well.
"""

from __future__ import annotations

import logging
import math
import os
import re
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from xml.parsers import expat

from anm_mj.utils.file_limits import MAX_CELLS, MAX_TEXTURE_MEGAPIXELS, limit
from anm_mj.utils.files import home_folder
from anm_mj.utils.picture import open_picture
from anm_mj.utils.read_file import is_below, open_regular, read_bytes

if TYPE_CHECKING:
    import mujoco

_logger = logging.getLogger(__name__)

MAX_ELEMENTS, MAX_ROBOT_ELEMENTS = (limit("ANM_MJ_MAX_ELEMENTS", default) for default in (40_000, 5_000))
"""Most elements of the MJCF file of a world, and of a robot, with all that it includes; copies count eight times."""
_MOST_NUMBERS = 1_000_000
"""Largest number of anything else that an MJCF file asks room for."""
TIMESTEPS_S = (1e-5, 0.1)
"""Shortest and longest step at which a file is simulated [s]: shorter ones take hours, longer ones fly apart."""
_COPY_COST = 8
_TEXTURE_COST = 2
"""MuJoCo keeps a picture at its full size, and a second time while it compiles."""
_MAX_MIB = 256
_HEAD_BYTES = 65536
LEVELS_UP = 3
"""A file may name others as far up as this number of folders above its own, as in ``../../assets``."""
_COUNTED = ("replicate", "flexcomp", "composite")
"""Elements that stand for as many others as their attribute ``count`` says."""


class OutsideError(ValueError):
    """A model names a file that lies where its files may not."""


def read_spec(
    path: Path, *, levels_up: int = LEVELS_UP, others: Sequence[Path] = (), option: str = "", robot: bool = False
) -> mujoco.MjSpec:
    """The parsed and uncompiled model in an MJCF or URDF file.

    Args:
        path: The file.
        levels_up: How many folders above its own the files that it names may lie; 0 = in its own alone.
        others: Further folders where they may lie.
        option: What names such folders, for the message.
        robot: Whether it is a robot, which is built several times.

    Raises:
        OSError: It, or a file that it names, cannot be read.
        OutsideError: It names files from elsewhere.
        ValueError: MuJoCo cannot read it, or it asks for too much.
    """
    import mujoco

    most = MAX_ROBOT_ELEMENTS if robot else MAX_ELEMENTS
    folder = Path(os.path.realpath(path)).parent
    own = _Places(top_folder(folder, levels_up), tuple(others), option)
    counter = _Counter(folder, own)
    elements = counter.elements(path)
    if elements > most:
        raise ValueError(
            f"it has {elements:.4g} elements, copies counted {_COPY_COST} times, but files end at {most}: set "
            "ANM_MJ_MAX_ELEMENTS to allow more"
        )
    try:
        with quiet_mujoco():
            spec = mujoco.MjSpec.from_file(str(path.absolute()))
    except Exception as err:  # MuJoCo has errors of its own.
        raise ValueError(str(err)) from err
    _check_assets(spec, path.absolute().parent, counter.attached_files(), own)
    return spec


def log_warnings() -> None:
    """Send MuJoCo's warnings to the log from now on, not to the terminal and to MUJOCO_LOG.TXT in the current folder;
    who simulates reads of faults in the data.
    """
    import mujoco

    mujoco.set_mju_user_warning(lambda text: _logger.debug("MuJoCo: %s", text))


@contextmanager
def quiet_mujoco() -> Iterator[None]:
    """Keep the warnings from the terminal that MuJoCo gives in C, as :func:`log_warnings`, and in Python."""
    log_warnings()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def compile_spec(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The model of a spec, without MuJoCo's warnings. Raises ValueError if MuJoCo cannot compile it."""
    with quiet_mujoco():
        return spec.compile()


def top_folder(folder: Path, levels_up: int) -> Path:
    """The folder below which the files that a model names may lie: up to ``levels_up`` above its own, links followed.

    Beyond the first, it is never the user's home or above.
    """
    home, top = home_folder(), folder
    for level, above in enumerate(folder.parents[:levels_up]):
        if above == Path(above.anchor) or (level > 0 and above in (home, *home.parents)):
            break
        top = above
    return top


def named_files(path: Path) -> list[Path]:
    """The files that exist of those that an MJCF file and its includes name; none where it cannot be read."""
    folder = Path(os.path.realpath(path)).parent
    counter = _Counter(folder, _Places(top_folder(folder, LEVELS_UP)))
    try:
        counter.elements(path)
    except (OSError, ValueError):
        return []
    found = {folder / below / name for below in counter.folders for name in counter.names}
    found |= {*counter.attached_files(), *(file for _, file in counter.known)}
    return sorted(file for file in found if os.path.isfile(file))


def root_tag(src: Path) -> str:
    """The name of the outermost element of an XML file, found in its beginning; empty for anything else."""
    try:
        with src.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return ""
    found = re.match(
        rb"(?:\xef\xbb\xbf)?(?:\s|<\?.*?\?>|<!--.*?-->|<!DOCTYPE[^>]*>)*<([A-Za-z_][\w.-]*)", head, re.DOTALL
    )
    return "" if found is None else found[1].decode()


def is_mjcf(src: Path) -> bool:
    """Whether a file is a MuJoCo model."""
    return src.suffix.lower() in (".xml", ".mjcf") and src.is_file() and root_tag(src) == "mujoco"


@dataclass(frozen=True)
class _Places:
    """Where the files that a model names may lie."""

    top: Path
    others: tuple[Path, ...] = ()
    option: str = ""
    """What names further folders."""

    def check(self, path: Path, name: str) -> None:
        """Raises OutsideError for a file that lies elsewhere."""
        if any(is_below(path, folder) for folder in (self.top, *self.others)):
            return
        also = f", or give its folder by {self.option}" if self.option else ""
        raise OutsideError(f"it names {name!r}, which lies outside of {self.top}: copy it there{also}")


@dataclass
class _Counter:
    """Counts elements, those of included files with them."""

    folder: Path
    """Names of files are relative to it, wherever they stand."""
    own: _Places
    known: dict[tuple[Path | None, Path], int] = field(default_factory=dict)
    """Elements by the model that they are of, as below, and file; 0 while one is being counted."""
    folders: set[str] = field(default_factory=lambda: {""})
    """Where ``<compiler>`` looks for files."""
    names: set[str] = field(default_factory=set)
    model: Path | None = None
    """The attached model that is being counted, whose files are found from its own folder; None in the file itself."""
    attached: dict[Path, tuple[set[str], set[str]]] = field(default_factory=dict)
    """Folders and names as above, of each attached model."""
    models: dict[tuple[Path | None, str], Path] = field(default_factory=dict)
    """Files that may be attached, by the model that names them and their name."""
    cells: int = 0
    """Pixels and cells so far that MuJoCo takes memory for while it reads."""
    cells_of: dict[Path, int] = field(default_factory=dict)
    """Those of each file that is counted."""

    def elements(self, path: Path) -> int:
        """Number of elements of a file."""
        key = (self.model, path)
        if key in self.known:
            return self.known[key]
        self.known[key] = 0
        # MuJoCo takes comments that XML forbids.
        text = re.sub(rb"<!--.*?-->", b"", read_bytes(path, _MAX_MIB), flags=re.DOTALL)
        # How often the elements that are open stand in the model, and whether they are copies.
        factors, total, before = [(1, False)], 0, self.cells
        for name, attributes in _tags(text):
            if name is None:
                factors.pop()
                continue
            (times, copied), more = factors[-1], 1
            self._take(_num_cells(name, attributes), name, attributes)
            _check_size(name, attributes)
            self._ask(name, attributes)
            count = _product(attributes.get("count", "1")) if name in _COUNTED else 1
            if name == "include":
                more += self.elements(self._file(path, attributes.get("file", "")))
            elif name == "model" and "file" in attributes:
                below = self._file(path, attributes["file"])
                self.models[self.model, attributes.get("name", below.stem)] = below
            elif name == "attach" and (below := self.models.get((self.model, attributes.get("model", "")))):
                above, self.model = self.model, below
                more += _COPY_COST * self.elements(below)
                self.model = above
                self._take(self.cells_of.get(below, 0), name, attributes)
            total += times * (_COPY_COST if copied else 1) * more + (times * _COPY_COST * count if count > 1 else 0)
            repeats = name == "replicate" and count > 1
            factors.append((times * count if repeats else times, copied or repeats))
        self.known[key], self.cells_of[path] = total, self.cells - before
        return total

    def attached_files(self) -> Iterator[Path]:
        """The files that exist of those that attached models name."""
        for model, (folders, names) in self.attached.items():
            # MuJoCo may be told to strip names of their folders.
            names = names | {Path(name).name for name in names}
            own = {model.parent / below / name for below in folders for name in names}
            yield from (file for file in sorted(own) if os.path.exists(file) and not os.path.isdir(file))

    def _ask(self, name: str, attributes: dict[str, str]) -> None:
        """Note the folders and files that an element names."""
        asked = (self.folders, self.names)
        folders, names = asked if self.model is None else self.attached.setdefault(self.model, ({""}, set()))
        if name == "compiler":
            folders |= {attributes[key] for key in ("assetdir", "meshdir", "texturedir") if key in attributes}
        names |= {text for key, text in attributes.items() if key.startswith("file")}

    def _take(self, cells: int, name: str, attributes: dict[str, str]) -> None:
        """Count the cells of an element; raises ValueError if there are too many with them."""
        self.cells += cells
        if self.cells > MAX_CELLS:
            raise ValueError(
                f"with its {name} '{attributes.get('name', '')}' it has {self.cells:.4g} cells of textures and height "
                f"fields, but they end at {MAX_CELLS}: set ANM_MJ_MAX_CELLS to allow more"
            )

    def _file(self, within: Path, name: str) -> Path:
        """A file that another one names; raises ValueError if it is nowhere, or elsewhere."""
        places = (self.folder / name, within.parent / name)
        found = next((place for place in places if place.is_file()), None)
        if found is None:
            raise ValueError(f"it includes {name!r}, which is no file")
        self.own.check(found, name)
        return found


def _tags(text: bytes) -> Iterator[tuple[str | None, dict[str, str]]]:
    """Names and attributes of an XML text's elements as they open; None as they close; ValueError if damaged."""
    found: list[tuple[str | None, dict[str, str]]] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda name, attributes: found.append((name, attributes))
    parser.EndElementHandler = lambda name: found.append((None, {}))
    try:
        for start in range(0, len(text), 1 << 16):
            parser.Parse(text[start : start + (1 << 16)])
            yield from found
            found.clear()
        parser.Parse(b"", True)
    except expat.ExpatError as err:
        raise ValueError(f"it is no well-formed XML: {err}") from err


def _product(text: str) -> int:
    """Product of the whole numbers in a text; 1 where there are none, which MuJoCo then says."""
    try:
        return math.prod(max(1, int(word)) for word in text.split()[:3])
    except ValueError:
        return 1


def _num_cells(name: str, attributes: dict[str, str]) -> int:
    """Pixels of a texture that MuJoCo makes, or cells of a height field; 0 for any other element."""
    if name not in ("texture", "hfield"):
        return 0
    sides = ("width", "height") if name == "texture" else ("nrow", "ncol")
    across, down = (_product(attributes.get(side, "1")) for side in sides)
    # The six pictures of a cube are as high as they are wide.
    is_cube = name == "texture" and attributes.get("type") != "2d" and "builtin" in attributes
    return 6 * across**2 if is_cube else across * down


def _check_size(name: str, attributes: dict[str, str]) -> None:
    """Raises ValueError for an element ``<size>`` that asks for too many numbers."""
    if name == "size":
        for key, text in attributes.items():
            if key not in ("memory", "njmax", "nconmax", "nstack") and _product(text) > _MOST_NUMBERS:
                raise ValueError(f"its size asks for {key} = {text}, but {_MOST_NUMBERS} is the most")


def _check_assets(spec: mujoco.MjSpec, folder: Path, attached: Iterable[Path], own: _Places) -> None:
    """Accept regular files of the model's own place alone, those of attached models too, and no more pixels and cells
    than memory bears.
    """
    megapixels = 0.0
    files = [(spec.meshdir, asset.file, False) for asset in (*spec.meshes, *spec.hfields, *spec.skins)]
    files += [(spec.texturedir, texture.file, True) for texture in spec.textures]
    files += [(spec.texturedir, file, True) for texture in spec.textures for file in texture.cubefiles]
    # Found as MuJoCo finds them; it says what is missing.
    strip = (lambda name: Path(name).name) if spec.strippath else str
    found = [(folder / below / strip(name), name, is_picture) for below, name, is_picture in files if name]
    found += [(path, path.name, False) for path in sorted({*attached} - {path for path, _, _ in found})]
    for path, name, is_picture in found:
        if not path.exists():
            continue
        own.check(path, name)
        if is_picture or path.suffix.lower() == ".png":
            megapixels += _megapixels(path)
            if _TEXTURE_COST * megapixels > MAX_TEXTURE_MEGAPIXELS:
                raise ValueError(
                    f"with {name!r} it has {megapixels:.0f} megapixels of textures, which count twice, but they end at "
                    f"{MAX_TEXTURE_MEGAPIXELS}: shrink them, or set ANM_MJ_MAX_TEXTURE_MEGAPIXELS to allow more"
                )
        else:
            open_regular(path).close()


def _megapixels(path: Path) -> float:
    """Size of a picture; 0 for MuJoCo's own formats. Raises ValueError for one that is none or too large."""
    if path.suffix.lower() not in (".png", ".jpg", ".jpeg", ".bmp", ".tga"):
        open_regular(path).close()
        return 0.0
    try:
        with open_picture(path) as picture:
            return picture.width * picture.height / 1e6
    except (OSError, ValueError) as err:
        raise ValueError(f"{path.name}: {err}") from err
