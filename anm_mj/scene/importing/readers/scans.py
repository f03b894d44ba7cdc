"""Scanned buildings in the folder layouts that they are published in: Gibson, Matterport3D, HM3D, Replica.

One mesh is the scene; the layout says which file that is, which axis points up, and whose terms apply. All are in
metres. The files that Habitat reads are z up although glTF prescribes y up.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.parsed_scene import ParsedScene
from anm_mj.scene.importing.readers.read_mesh import read_mesh

_MATTERPORT_ID = re.compile(r"[A-Za-z0-9]{11}")
_HM3D_FOLDER = re.compile(r"\d{5}-[A-Za-z0-9]{11}")

_CERTAINTY = 2.0
"""The layout is better evidence for the up axis than the geometry, unless that is overwhelming."""


@dataclass(frozen=True)
class ScanLayout:
    """How one data set lays out its scenes."""

    name: str
    title: str
    licence: str
    find: Callable[[Path], Path | None]
    """The mesh in a scene's folder, or a file if it is one of the data set; None for anything else."""
    file_hint: str
    """The mesh to look for, in words."""

    def matches(self, src: Path) -> bool:
        """Whether a file or folder is laid out so."""
        return self.find(src) is not None


def read_scan(layout: ScanLayout, src: Path, model_paths: Sequence[Path], report: ImportReport) -> ParsedScene:
    """The scene in a folder or file. Raises SceneError if a folder lacks the layout's mesh, or it cannot be read."""
    del model_paths
    mesh = src if src.is_file() else layout.find(src)
    if mesh is None:
        raise SceneError(f"{src} does not hold a {layout.title} scene: give the folder that holds {layout.file_hint}.")
    up = "y" if mesh.name == "mesh.obj" and layout.name == "gibson" else "z"
    where = mesh.name if src.is_file() else f"{src.resolve().name}/{mesh.relative_to(src).as_posix()}"
    return ParsedScene(
        read_mesh(mesh, report),
        source=f"{layout.title}, {where}",
        licence=layout.licence,
        up=up,
        up_certainty=_CERTAINTY,
        scale=1.0,
    )


def _first(paths: Iterable[Path]) -> Path | None:
    return next((path for path in paths if path.is_file()), None)


def _within(path: Path, *names: str) -> bool:
    """Whether a folder above a file, but the outermost, has one of the names (in small letters)."""
    return any(part.lower() in names for part in path.absolute().parent.parts[1:])


def _find_gibson(src: Path) -> Path | None:
    """Habitat's <Scene>.glb in a folder named gibson; iGibson's and GibsonEnv's folder with mesh_z_up.obj."""
    if src.is_dir():
        own = any((src / name).exists() for name in ("camera_poses.csv", "floors.txt", "pano"))
        return _first([src / "mesh_z_up.obj", *([src / "mesh.obj"] if own else [])])
    if src.name == "mesh_z_up.obj":
        return src
    return src if src.suffix.lower() == ".glb" and _within(src, "gibson", "gibson_habitat") else None


def _find_matterport(src: Path) -> Path | None:
    """Habitat's <id>.glb, the original matterport_mesh/<hash>/<hash>.obj, and the point-coloured .ply meshes."""
    if src.is_dir():
        scene = src.name
        if not _MATTERPORT_ID.fullmatch(scene):
            return None
        textured = sorted(src.glob("matterport_mesh/*/*.obj"))
        habitat = [src / f"{scene}.glb"] if (src / f"{scene}.house").is_file() or _within(src / "_", "mp3d") else []
        coloured = [src / "poisson_meshes" / f"{scene}.ply", src / "house_segmentations" / f"{scene}.ply"]
        return _first([*habitat, *textured, *coloured])
    suffix = src.suffix.lower()
    if suffix == ".glb":
        named = _MATTERPORT_ID.fullmatch(src.stem) is not None
        return src if named and (src.with_suffix(".house").is_file() or _within(src, "mp3d")) else None
    if suffix == ".obj":
        return src if src.parent.parent.name == "matterport_mesh" else None
    known = src.parent.name in ("poisson_meshes", "house_segmentations", "region_segmentations")
    semantic = src.stem.endswith("_semantic") and _MATTERPORT_ID.fullmatch(src.stem.removesuffix("_semantic"))
    return src if suffix == ".ply" and (known or semantic) else None


def _find_hm3d(src: Path) -> Path | None:
    """The folder <number>-<id> with <id>.glb, or <id>.basis.glb where there is nothing else."""
    if src.is_file():
        own = _HM3D_FOLDER.fullmatch(src.absolute().parent.name) or src.name.lower().endswith(".basis.glb")
        return src if own and src.suffix.lower() in (".glb", ".obj") else None
    if not _HM3D_FOLDER.fullmatch(src.resolve().name):
        return None
    scene = src.resolve().name.partition("-")[2]
    return _first([src / f"{scene}.glb", src / f"{scene}.obj", src / f"{scene}.basis.glb"])


def _find_replica(src: Path) -> Path | None:
    """mesh.ply beside the other files of a Replica scene, or its semantic twin in habitat/."""
    folder = src if src.is_dir() else src.absolute().parent
    if src.is_file() and src.name == "mesh_semantic.ply" and folder.name == "habitat":
        return src
    if src.is_file() and src.name != "mesh.ply":
        return None
    beside = ("habitat", "semantic.json", "semantic.bin", "glass.sur", "preseg.bin")
    own = any((folder / name).exists() for name in beside)
    return _first([folder / "mesh.ply"]) if own else None


SCAN_LAYOUTS = (
    ScanLayout(
        "hm3d",
        "Habitat-Matterport 3D (HM3D)",
        "Matterport End User License Agreement for Academic Use of Model Data (HM3D; non-commercial)",
        _find_hm3d,
        "<id>.glb, named <number>-<id>",
    ),
    ScanLayout(
        "matterport3d",
        "Matterport3D",
        "Matterport3D Terms of Use (academic, non-commercial)",
        _find_matterport,
        "<id>.glb or matterport_mesh/, named by the scene's id of 11 letters and digits",
    ),
    ScanLayout(
        "gibson",
        "Gibson Database of Spaces",
        "Gibson Dataset Agreement (research and education, non-commercial)",
        _find_gibson,
        "mesh_z_up.obj or mesh.obj",
    ),
    ScanLayout(
        "replica",
        "Replica",
        "Replica Research Terms (non-commercial)",
        _find_replica,
        "mesh.ply beside habitat/ and semantic.json",
    ),
)
"""The data sets of scans; the first that knows a source has it."""
