"""The folder of one run: creation of the folder and paths of its files.

The file names are a public contract; other programs read them.
"""

from __future__ import annotations

import itertools
import os
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from anm_mj.errors import RunFolderError
from anm_mj.utils.close_names import close_name

RUNS = Path("runs")
"""Default parent of run folders, relative to the working directory."""


class _Member:
    """The path of a file or folder in the run folder."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __get__(self, folder: RunFolder, _: type) -> Path:
        return folder.path / self.name


@dataclass(frozen=True)
class RunFolder:
    """Paths of the files of a run."""

    path: Path
    manifest = _Member("manifest.json")
    """Provenance: versions, machine, scene, seed."""
    config = _Member("config.json")
    """The effective configuration."""
    steps = _Member("steps.jsonl")
    """One line per step."""
    plans = _Member("plans.jsonl")
    """One line per decision."""
    frames = _Member("frames.jsonl")
    """One line per observation: time and poses."""
    camera = _Member("camera.json")
    """Intrinsics of the original images, and the reduction of the depth images."""
    curve = _Member("curve.csv")
    """Completion over steps."""
    metrics = _Member("metrics.json")
    """Metrics of the whole run."""
    trajectory = _Member("trajectory.tum")
    """Base poses in TUM format."""
    true_trajectory = _Member("trajectory_true.tum")
    """True base poses in TUM format, where they differ from the believed ones."""
    camera_trajectory = _Member("trajectory_camera.tum")
    """Camera poses of a tracked sequence in TUM format."""
    mesh = _Member("mesh.ply")
    """The coloured mesh of the neural map."""
    map = _Member("map.safetensors")
    """The neural map."""
    topdown_picture = _Member("topdown.png")
    """Figure of the top-down map, graph, regions and trajectory."""
    fit_picture = _Member("fit.png")
    """Figure of how well the frames of a recorded sequence fit their map."""
    curve_picture = _Member("curve.png")
    """Figure of completion over steps."""
    ground_truth = _Member("ground_truth.npz")
    """The true surface and its samples."""
    explored = _Member("explored.safetensors")
    """What a later run needs beside the map to go on from this one (:mod:`anm_mj.io.explored_file`)."""
    covered_before = _Member("covered_before.npz")
    """Of a run that goes on from another one: how near each sample of the true surface had been seen before."""
    changes = _Member("changes.json")
    """Of such a run: surface that is gone or new since then (:mod:`anm_mj.io.changes_file`)."""
    changed_voxels = _Member("changes.npz")
    """The voxels of these changes."""
    checkpoints = _Member("checkpoint")
    """Folder of the state from which a killed run goes on; gone once the run has finished."""
    resumed = _Member("resumed.jsonl")
    """One line per time that the run was resumed."""
    novel_views = _Member("novel_views.json")
    """How well the map shows its scene from places where the robot was not."""
    novel_views_picture = _Member("novel_views.png")
    """Some of these views beside the true ones."""
    fixed_views = _Member("fixed_views.json")
    """How well the map shows its scene from places that are the same for all runs."""
    survey = _Member("survey.npz")
    """Top-down map, graph and regions of the final map (:mod:`anm_mj.io.plan_file`)."""

    @classmethod
    def create(cls, out: Path | None, scene_name: str, policy: str, runs: Path = RUNS) -> RunFolder:
        """Create the folder of a new run: ``out``, or ``<runs>/<scene>_<policy>_<time stamp>`` with a link
        ``<runs>/latest`` to it. The policy's name may be ``module:Name``. Raises RunFolderError if the path is a file
        or a non-empty folder, or cannot be created.
        """
        path = out if out is not None else runs / _stem(scene_name, policy)
        try:
            path = _numbered(path) if out is None else empty_folder(path)
            (path / "depth").mkdir()
        except OSError as err:
            raise RunFolderError(f"{path} cannot be made ({err.strerror}); choose a folder you may write to.") from err
        if out is None:
            _point_latest_to(path)
        return cls(path)

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """The folder of an existing run, without links: one such as ``runs/latest`` leads somewhere else once a new run
        has a folder. Raises RunFolderError if there is no such folder, or it contains no run.
        """
        if not os.path.isdir(path):  # Unlike Path.is_dir, never an error.
            close = close_name(str(path), _folders_beside(path))
            raise RunFolderError(f"{path} is not a folder{close}; give the folder that a run wrote.")
        folder = cls(_real(path))
        for needed in (folder.steps, folder.frames, folder.camera):
            if not needed.is_file():
                raise RunFolderError(f"{path} is not the folder of a run: it has no {needed.name}.")
        return folder

    def drop_results(self) -> None:
        """Delete what stands for the finished run: what an interruption left would pass for it if the run, resumed, is
        killed. What a killed program had half written goes, too.
        """
        partial = [path for folder in (self.path, self.checkpoints) for path in folder.glob(f".*.{'?' * 32}")]
        for path in (*self.results, *partial):
            path.unlink(missing_ok=True)

    @property
    def results(self) -> tuple[Path, ...]:
        """What a run writes at its end, and what is made of that; some of it may not be there."""
        kept = (self.metrics, self.map, self.explored, self.mesh, self.survey, self.true_trajectory)
        changes = (self.changes, self.changed_voxels)
        pictures = (self.topdown_picture, self.fit_picture, self.curve_picture)
        return (*kept, *changes, *pictures, self.novel_views, self.novel_views_picture, self.fixed_views)

    def plan(self, step: int) -> Path:
        """What the decision after ``step`` actions was read from (:mod:`anm_mj.io.plan_file`)."""
        return self.path / "plans" / f"{step:06d}.npz"

    def image(self, step: int) -> Path:
        """Colour image of the observation after ``step`` actions."""
        return self.path / "rgb" / f"{step:06d}.jpg"

    def depth(self, step: int) -> Path:
        """Reduced depth of the observation after ``step`` actions: 16-bit PNG [mm], 0 without a hit."""
        return self.path / "depth" / f"{step:06d}.png"


def _real(path: Path) -> Path:
    """A path without links, from the working directory where it lies below."""
    real, here = path.resolve(), Path.cwd().resolve()
    return real.relative_to(here) if real.is_relative_to(here) else real


def _folders_beside(path: Path) -> list[str]:
    try:
        return [str(one) for one in path.parent.iterdir() if one.is_dir()]
    except OSError:
        return []


def _stem(scene_name: str, policy: str) -> str:
    readable = "".join(c if c.isalnum() or c in "-." else "-" for c in policy)
    return f"{Path(scene_name).stem}_{readable}_{datetime.now():%Y%m%d-%H%M%S}"


def _numbered(path: Path) -> Path:
    """Create a folder of this name, with a number if another run has just taken the name."""
    path.parent.mkdir(parents=True, exist_ok=True)
    for count in itertools.count(1):
        numbered = path if count == 1 else path.with_name(f"{path.name}-{count}")
        try:
            numbered.mkdir()
        except FileExistsError:
            continue
        return numbered
    raise AssertionError("counting never ends")


def empty_folder(path: Path) -> Path:
    """Create a folder unless it exists, and require it to be empty. Raises RunFolderError if it is not empty."""
    path.mkdir(parents=True, exist_ok=True)
    if any(path.iterdir()):
        raise RunFolderError(f"{path} is not empty; choose another folder, or remove this one.")
    return path


def refuse_links(path: Path) -> None:
    """Refuse to write into a folder of somebody's run where a file may lead somewhere else. Raises RunFolderError if
    there is a link below ``path``.
    """
    found = next((place for place in (path, *path.rglob("*")) if place.is_symlink()), None)
    if found is not None:
        raise RunFolderError(f"{found} is a link, through which nothing is written; copy the run again.")


def _point_latest_to(path: Path) -> None:
    latest = path.parent / "latest"
    if latest.exists() and not latest.is_symlink():
        return
    fresh = path.parent / f".latest-{os.getpid()}"
    try:
        fresh.symlink_to(path.name)
        os.replace(fresh, latest)
    except OSError:
        # Some file systems have no links; the run works without one.
        fresh.unlink(missing_ok=True)
