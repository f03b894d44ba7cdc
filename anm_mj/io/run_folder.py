"""The folder of one run: creation of the folder and paths of its files.

The file names are a public contract; other programs read them.
"""

from __future__ import annotations

import itertools
import os
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from anm_mj.errors import RunFolderError
from anm_mj.io.to_json import write_json
from anm_mj.utils.close_names import close_name

RUNS = Path("runs")
"""Default parent of run folders, relative to the working directory."""


@dataclass(frozen=True)
class RunFolder:
    """Paths of the files of a run."""

    path: Path

    @classmethod
    def create(cls, out: Path | None, scene_name: str, policy: str, runs: Path = RUNS) -> RunFolder:
        """Create the folder of a new run.

        Args:
            out: Its path; None = ``<runs>/<scene>_<policy>_<time stamp>``, with a link ``<runs>/latest`` to it.
            scene_name: Name of the scene.
            policy: Name of the policy, possibly ``module:Name``.
            runs: Parent of automatically named folders.

        Raises:
            RunFolderError: The path is a file or a non-empty folder, or cannot be created.
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
        """The folder of an existing run.

        Raises:
            RunFolderError: There is no such folder, or it contains no run.
        """
        if not os.path.isdir(path):  # Unlike Path.is_dir, never an error.
            close = close_name(str(path), _folders_beside(path))
            raise RunFolderError(f"{path} is not a folder{close}; give the folder that a run wrote.")
        folder = cls(path)
        for needed in (folder.steps, folder.frames, folder.camera):
            if not needed.is_file():
                raise RunFolderError(f"{path} is not the folder of a run: it has no {needed.name}.")
        return folder

    @property
    def manifest(self) -> Path:
        """Provenance: versions, machine, scene, seed."""
        return self.path / "manifest.json"

    @property
    def config(self) -> Path:
        """The effective configuration."""
        return self.path / "config.json"

    @property
    def steps(self) -> Path:
        """One line per step."""
        return self.path / "steps.jsonl"

    @property
    def plans(self) -> Path:
        """One line per decision."""
        return self.path / "plans.jsonl"

    @property
    def frames(self) -> Path:
        """One line per observation: time and poses."""
        return self.path / "frames.jsonl"

    @property
    def camera(self) -> Path:
        """Intrinsics of the original images, and the reduction of the depth images."""
        return self.path / "camera.json"

    @property
    def curve(self) -> Path:
        """Completion over steps."""
        return self.path / "curve.csv"

    @property
    def metrics(self) -> Path:
        """Metrics of the whole run."""
        return self.path / "metrics.json"

    @property
    def trajectory(self) -> Path:
        """Base poses in TUM format."""
        return self.path / "trajectory.tum"

    @property
    def true_trajectory(self) -> Path:
        """True base poses in TUM format, where they differ from the believed ones."""
        return self.path / "trajectory_true.tum"

    @property
    def camera_trajectory(self) -> Path:
        """Camera poses of a tracked sequence in TUM format."""
        return self.path / "trajectory_camera.tum"

    @property
    def mesh(self) -> Path:
        """The coloured mesh of the neural map."""
        return self.path / "mesh.ply"

    @property
    def map(self) -> Path:
        """The neural map; that of a run of an older version has the name that it had then."""
        path = self.path / "map.safetensors"
        former = self.path / "map.pt"
        return former if former.is_file() and not path.is_file() else path

    @property
    def topdown_picture(self) -> Path:
        """Figure of the top-down map, graph, regions and trajectory."""
        return self.path / "topdown.png"

    @property
    def fit_picture(self) -> Path:
        """Figure of how well the frames of a recorded sequence fit their map."""
        return self.path / "fit.png"

    @property
    def curve_picture(self) -> Path:
        """Figure of completion over steps."""
        return self.path / "curve.png"

    @property
    def ground_truth(self) -> Path:
        """The true surface and its samples."""
        return self.path / "ground_truth.npz"

    @property
    def explored(self) -> Path:
        """What a later run needs beside the map to go on from this one (:mod:`anm_mj.io.explored_file`)."""
        return self.path / "explored.safetensors"

    @property
    def covered_before(self) -> Path:
        """Of a run that goes on from another one: how near each sample of the true surface had been seen before."""
        return self.path / "covered_before.npz"

    @property
    def changes(self) -> Path:
        """Of such a run: surface that is gone or new since then (:mod:`anm_mj.io.changes_file`)."""
        return self.path / "changes.json"

    @property
    def changed_voxels(self) -> Path:
        """The voxels of these changes."""
        return self.path / "changes.npz"

    @property
    def checkpoints(self) -> Path:
        """Folder of the state from which a killed run goes on; gone once the run has finished."""
        return self.path / "checkpoint"

    @property
    def resumed(self) -> Path:
        """One line per time that the run was resumed."""
        return self.path / "resumed.jsonl"

    def write_manifest(self, manifest: dict[str, Any]) -> None:
        """Write the provenance of the run.

        Raises:
            RunFolderError: The file cannot be written.
        """
        write_json(self.manifest, manifest)

    def write_config(self, config: object) -> None:
        """Write the effective configuration, a dataclass of dataclasses.

        Raises:
            RunFolderError: The file cannot be written.
        """
        write_json(self.config, config)

    @property
    def survey(self) -> Path:
        """Top-down map, graph and regions of the final map (:mod:`anm_mj.io.plan_file`)."""
        return self.path / "survey.npz"

    def plan(self, step: int) -> Path:
        """What the decision after ``step`` actions was read from (:mod:`anm_mj.io.plan_file`)."""
        return self.path / "plans" / f"{step:06d}.npz"

    def image(self, step: int) -> Path:
        """Colour image of the observation after ``step`` actions."""
        return self.path / "rgb" / f"{step:06d}.jpg"

    def depth(self, step: int) -> Path:
        """Reduced depth of the observation after ``step`` actions: 16-bit PNG [mm], 0 without a hit."""
        return self.path / "depth" / f"{step:06d}.png"


def _folders_beside(path: Path) -> list[str]:
    """The folders in the same place as a path."""
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
    """Create a folder unless it exists, and require it to be empty.

    Raises:
        RunFolderError: It is not empty.
    """
    path.mkdir(parents=True, exist_ok=True)
    if any(path.iterdir()):
        raise RunFolderError(f"{path} is not empty; choose another folder, or remove this one.")
    return path


def refuse_links(path: Path) -> None:
    """Refuse to write into a folder of somebody's run where a file may lead somewhere else.

    Raises:
        RunFolderError: Below ``path`` there is a link.
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
