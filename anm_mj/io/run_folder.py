"""The folder of one run: where each file lies, and how a new one is made.

The names are a contract: what other programs read of a run, they find here.
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

RUNS = Path("runs")
"""Where runs go unless told otherwise, relative to the working directory."""


@dataclass(frozen=True)
class RunFolder:
    """Paths of all that a run leaves."""

    path: Path

    @classmethod
    def create(cls, out: Path | None, scene_name: str, policy: str, runs: Path = RUNS) -> RunFolder:
        """Make the folder of a new run.

        Args:
            out: Where; None makes ``<runs>/<scene>_<policy>_<time stamp>`` and lets ``<runs>/latest`` point there.
            scene_name: Name of the scene.
            policy: Name of the policy, possibly ``module:Name``.
            runs: Parent of folders that are named here.

        Raises:
            RunFolderError: The folder holds files already, is a file, or cannot be made.
        """
        path = out if out is not None else runs / _stem(scene_name, policy)
        try:
            path = _made(path) if out is None else _empty(path)
            (path / "depth").mkdir()
        except OSError as err:
            raise RunFolderError(f"{path} cannot be made ({err.strerror}); choose a folder you may write to.") from err
        if out is None:
            _point_latest_to(path)
        return cls(path)

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """The folder of a run that has been made.

        Raises:
            RunFolderError: There is no such folder, or it is not one of a run.
        """
        if not os.path.isdir(path):  # Unlike Path.is_dir, never an error.
            raise RunFolderError(f"{path} is not a folder; give the folder that a run wrote.")
        folder = cls(path)
        for needed in (folder.steps, folder.frames, folder.camera, folder.ground_truth):
            if not needed.is_file():
                raise RunFolderError(f"{path} is not the folder of a run: it has no {needed.name}.")
        return folder

    @property
    def manifest(self) -> Path:
        """With what the run was made: versions, machine, scene, seed."""
        return self.path / "manifest.json"

    @property
    def config(self) -> Path:
        """The effective configuration."""
        return self.path / "config.json"

    @property
    def steps(self) -> Path:
        """A line per step."""
        return self.path / "steps.jsonl"

    @property
    def plans(self) -> Path:
        """A line per decision."""
        return self.path / "plans.jsonl"

    @property
    def frames(self) -> Path:
        """A line per observation: when, from where."""
        return self.path / "frames.jsonl"

    @property
    def camera(self) -> Path:
        """Intrinsics of the original images, and how the depth was reduced."""
        return self.path / "camera.json"

    @property
    def curve(self) -> Path:
        """Completion against steps."""
        return self.path / "curve.csv"

    @property
    def metrics(self) -> Path:
        """The numbers of the whole run."""
        return self.path / "metrics.json"

    @property
    def trajectory(self) -> Path:
        """Base poses in TUM format."""
        return self.path / "trajectory.tum"

    @property
    def mesh(self) -> Path:
        """The coloured mesh out of the neural map."""
        return self.path / "mesh.ply"

    @property
    def map(self) -> Path:
        """The neural map itself."""
        return self.path / "map.pt"

    @property
    def topdown_picture(self) -> Path:
        """Map, graph, regions and trajectory from above."""
        return self.path / "topdown.png"

    @property
    def curve_picture(self) -> Path:
        """Completion against steps, drawn."""
        return self.path / "curve.png"

    @property
    def ground_truth(self) -> Path:
        """The true surface and its samples."""
        return self.path / "ground_truth.npz"

    def write_manifest(self, manifest: dict[str, Any]) -> None:
        """Write with what the run is made.

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

    def depth(self, step: int) -> Path:
        """Reduced depth of the observation after ``step`` actions: 16-bit PNG, millimetres, 0 where nothing."""
        return self.path / "depth" / f"{step:06d}.png"


def _stem(scene_name: str, policy: str) -> str:
    readable = "".join(c if c.isalnum() or c in "-." else "-" for c in policy)
    return f"{Path(scene_name).stem}_{readable}_{datetime.now():%Y%m%d-%H%M%S}"


def _made(path: Path) -> Path:
    """A new folder of this name, or with a number after it when another run has just taken the name."""
    path.parent.mkdir(parents=True, exist_ok=True)
    for count in itertools.count(1):
        numbered = path if count == 1 else path.with_name(f"{path.name}-{count}")
        try:
            numbered.mkdir()
        except FileExistsError:
            continue
        return numbered
    raise AssertionError("counting never ends")


def _empty(path: Path) -> Path:
    """The folder at a path, made if need be.

    Raises:
        RunFolderError: It holds something.
    """
    path.mkdir(parents=True, exist_ok=True)
    if any(path.iterdir()):
        raise RunFolderError(f"{path} is not empty; choose another folder, or remove this one.")
    return path


def _point_latest_to(path: Path) -> None:
    latest = path.parent / "latest"
    if latest.exists() and not latest.is_symlink():
        return
    fresh = path.parent / f".latest-{os.getpid()}"
    try:
        fresh.symlink_to(path.name)
        os.replace(fresh, latest)
    except OSError:
        # Some file systems know no links; the run itself does not need one.
        fresh.unlink(missing_ok=True)
