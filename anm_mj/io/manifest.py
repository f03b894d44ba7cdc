"""With what a run was made: enough to make it again, or to say why it cannot be."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from anm_mj.io.to_json import to_json

PACKAGES = ("anm-mj", "mujoco", "dm-control", "torch", "pin", "mink", "numpy", "scipy", "scikit-image", "trimesh")
"""Packages whose version can change a run."""


@dataclass(frozen=True)
class RunFacts:
    """What only the one who starts a run knows."""

    scene: str
    """Name or path of the scene, as given."""
    scene_hash: str
    """Hash over the scene's files."""
    robot: str
    """Name or path of the robot, as given."""
    robot_hash: str
    """Hash over the robot as the simulator reads it."""
    policy: str
    seed: int
    device: str
    """Where the neural map is trained: ``cpu``, or the GPU with its name."""
    engine: str
    """What trains it: ``torch``, or ``native`` with its instruction set."""
    gl_backend: str
    """What ``MUJOCO_GL`` was in effect."""
    gl_renderer: str
    """What the GL driver calls itself."""
    camera: str
    """What made the pictures: ``gl``, ``embree`` or ``mujoco rays``."""


def manifest(facts: RunFacts, command: list[str]) -> dict[str, Any]:
    """The manifest of a run on this machine.

    Args:
        facts: What the machine does not know.
        command: The command line.
    """
    return {
        **to_json(facts),
        "command": command,
        "packages": {name: _version(name) for name in PACKAGES},
        "git": git_revision(Path(__file__).parent),
        "python": platform.python_version(),
        "machine": {
            "system": platform.platform(),
            "cpu": cpu_model(),
            "cores": os.cpu_count(),
            "memory_mib": memory_mib(),
        },
    }


def git_revision(folder: Path) -> dict[str, Any] | None:
    """Revision of the checkout that holds a folder and whether it has changes; None outside of any."""
    git = ["git", "-C", str(folder)]
    try:
        run = {"capture_output": True, "text": True, "timeout": 10, "check": True}
        revision = subprocess.run([*git, "rev-parse", "HEAD"], **run).stdout.strip()
        changes = subprocess.run([*git, "status", "--porcelain", "--untracked-files=no"], **run).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
    return {"revision": revision, "changed": bool(changes)}


def cpu_model() -> str:
    """What the processor calls itself."""
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(encoding="utf-8"), re.MULTILINE)
    except OSError:
        found = None
    return found.group(1) if found else platform.processor() or platform.machine()


def memory_mib() -> int | None:
    """Physical memory [MiB]; None where the system does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2**20
    except (AttributeError, ValueError, OSError):
        return None


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
