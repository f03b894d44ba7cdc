"""Provenance of a run: versions, machine, scene and robot, for reproduction."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from anm_mj.io.to_json import to_json
from anm_mj.types import Footprint
from anm_mj.utils.package_data import checkout

PACKAGES = ("anm-mj", "mujoco", "dm-control", "torch", "pin", "mink", "numpy", "scipy", "scikit-image", "trimesh")
"""Packages whose version can affect a run."""


@dataclass(frozen=True)
class RunFacts:
    """Facts of a run that the caller knows."""

    scene: str
    """Name or path of the scene, as given."""
    scene_hash: str
    """Hash of the scene's files."""
    robot: str
    """Name or path of the robot, as given."""
    robot_hash: str
    """Hash of the robot in MuJoCo's reading."""
    policy: str
    goal: str
    """What the run was for: ``coverage``, ``reconstruction`` or ``both``."""
    seed: int
    device: str
    """Device that trains the neural map: ``cpu``, or the name of the GPU."""
    engine: str
    """Engine that trains it: ``torch``, or ``native`` with its instruction set."""
    gl_backend: str
    """Value of ``MUJOCO_GL``."""
    gl_renderer: str
    """GL_RENDERER of the driver."""
    camera: str
    """Rendering method: ``gl``, ``embree`` or ``mujoco rays``."""
    sensor: str
    """Name of the sensor whose errors were simulated."""
    people: int = 0
    footprint: Footprint | None = None
    """The space that the robot sweeps; None for a recorded sequence."""
    reality: str = ""
    """The world that options and settings began with; empty where nothing was simulated."""
    continued_from: dict[str, Any] | None = None
    """The run that this one goes on from: its folder (``run``), the ``scene_hash`` of its scene, and the number of
    ``frames`` of it and of those that it went on from. None for a run that began with nothing."""
    corrections: tuple[str, ...] = ()
    """Options that a check of the recorded sequence found, and ``--fix`` applied."""
    origin_m: tuple[float, float, float] | None = None
    """Where the origin of the run's world lies in that of the recorded sequence, turned so that z points up [m]. None
    for a run of a robot."""

    @classmethod
    def unsimulated(
        cls,
        kind: str,
        *,
        scene: str,
        policy: str,
        goal: str,
        seed: int,
        device: str,
        engine: str,
        footprint: Footprint | None = None,
    ) -> RunFacts:
        """Of a run of ``kind``, live or recorded, in which neither robot nor camera is simulated."""
        return cls(scene, "", kind, "", policy, goal, seed, device, engine, kind, kind, kind, kind, footprint=footprint)


def manifest(facts: RunFacts, command: list[str]) -> dict[str, Any]:
    """The manifest of a run on this machine."""
    return {
        **to_json(facts),
        "started": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "command": command,
        "packages": {name: _version(name) for name in PACKAGES},
        # A wheel may be installed within the repository of another project.
        "git": None if (source := checkout()) is None else git_revision(source),
        "python": platform.python_version(),
        "machine": {
            "system": platform.platform(),
            "cpu": cpu_model(),
            "cores": os.cpu_count(),
            "memory_mib": memory_mib(),
        },
    }


def git_revision(folder: Path) -> dict[str, Any] | None:
    """Git revision of the checkout around a folder, and whether it has changes; None outside of a checkout."""
    git = ["git", "-C", str(folder)]
    try:
        run = {"capture_output": True, "text": True, "timeout": 10, "check": True}
        revision = subprocess.run([*git, "rev-parse", "HEAD"], **run).stdout.strip()
        changes = subprocess.run([*git, "status", "--porcelain", "--untracked-files=no"], **run).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
    return {"revision": revision, "changed": bool(changes)}


def cpu_model() -> str:
    """Model name of the processor."""
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(encoding="utf-8"), re.MULTILINE)
    except OSError:
        found = None
    return found.group(1) if found else platform.processor() or platform.machine()


def memory_mib() -> int | None:
    """Physical memory [MiB]; None if the system does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2**20
    except (AttributeError, ValueError, OSError):
        return None


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
