"""What a run is called in a figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from anm_mj.io.read_run import read_json
from anm_mj.io.run_folder import RunFolder


def run_title(folder: RunFolder) -> str:
    """Scene, policy and seed of a run; the folder's name where it has no manifest.

    Raises:
        RunFolderError: The manifest cannot be read.
    """
    facts: dict[str, Any] = read_json(folder.manifest) if folder.manifest.is_file() else {}
    if "scene" not in facts:
        return folder.path.name
    policy = f", {facts['policy']}" if facts.get("policy") else ""
    seed = f", seed {facts['seed']}" if facts.get("seed") is not None else ""
    return f"{Path(facts['scene']).name}{policy}{seed}"
