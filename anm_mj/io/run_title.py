"""What a run is called in a figure, and what it came to."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from anm_mj.io.read_run import read_json
from anm_mj.io.run_folder import RunFolder


def run_title(folder: RunFolder) -> str:
    """Scene, policy and seed of a run, or its folder's name. Raises RunFolderError for an unreadable manifest."""
    facts: dict[str, Any] = read_json(folder.manifest) if folder.manifest.is_file() else {}
    if "scene" not in facts:
        return folder.path.name
    policy = f", {facts['policy']}" if facts.get("policy") else ""
    seed = f", seed {facts['seed']}" if facts.get("seed") is not None else ""
    title = f"{Path(str(facts['scene'])).name}{policy}{seed}"
    # Fonts have no glyph for what commands a terminal, and warn of it.
    return "".join(c if c.isprintable() else " " for c in title)


def titled(folder: RunFolder, metrics: Mapping[str, Any]) -> str:
    """Two lines: what the run is, and its headline metric and length; what is missing or None is left out. ``metrics``
    have the keys of ``metrics.json``. Raises RunFolderError if the manifest cannot be read.
    """
    parts = []
    for key, words in (("observable_ratio", "of the observable surface"), ("completion_ratio", "of the surface")):
        if metrics.get(key) is not None and not parts:
            parts.append(f"{metrics[key]:.1f} % {words}")
    for key, form in (("steps", "{} steps"), ("frames", "{} recorded frames"), ("path_m", "{:.1f} m")):
        if metrics.get(key) is not None:
            parts.append(form.format(metrics[key]))
    return "\n".join([run_title(folder), ", ".join(parts)] if parts else [run_title(folder)])
