"""The command lines that read each kind of input."""

from __future__ import annotations

from pathlib import Path

_SHORT = ("--preset", "quick", "--set", "mapping.schedule.first_iterations=5")


def commands(kind: str, paths: dict[str, Path]) -> list[tuple[str, ...]]:
    """Every command that reads this kind of input.

    Args:
        kind: of input.
        paths: the good inputs; without one of this kind, the commands name none that is there.
    """
    name = f"in/{paths[kind].name if kind in paths else kind}"
    if kind == "scene":
        return [("scene", "check", name), ("explore", name, *_SHORT, "--steps", "1", "--out", "out")]
    if kind == "run":
        # The views of eval --novel-views take half a minute.
        return [
            ("eval", name),
            ("view", name, "--export-html", "out.html"),
            ("export", name, "--format", "all", "--out", "out"),
            ("export", name, "--video", "out.gif"),
            ("map", name, *_SHORT, "--out", "out"),
            ("explore", str(paths["scene"]), *_SHORT, "--continue", name, "--steps", "1", "--out", "out"),
        ]
    if kind == "killed":
        return [("explore", "--resume", name)]
    if kind == "robot":
        return [
            ("robot", "check", name, "--out", "out.png"),
            ("explore", "flat", *_SHORT, "--robot", name, "--steps", "1", "--out", "out"),
        ]
    if kind == "bench":
        return [("bench", name, "--out", "out")]
    if kind == "benched":
        return [("bench", "in/bench.toml", "--out", name)]
    if kind in SEQUENCES:
        given = ("--camera", "32,32,32,32") if kind == "7scenes" else ()
        return [("map", name, *_SHORT, *given, "--out", "out")]
    return [("scene", "import", name, "out", *(("--up", "z") if kind in ("obj", "ply", "stl") else ()))]


SEQUENCES = (
    *("tum", "nerfstudio", "replica", "sequence"),
    *("7scenes", "scannet", "stray", "polycam", "record3d", "arkitscenes", "icl", "open3d"),
    *("bag", "bag-file", "bag-message", "mcap", "mcap-zstd", "bag1", "bag1-bz2"),
)
"""Kinds of recorded sequences."""
READERS_OF = {
    "config.json": (0, 1, 5),
    "manifest.json": (0, 1, 2, 5),
    "camera.json": (0, 1, 4, 5),
    "frames.jsonl": (0, 1, 2, 3, 4, 5),
    "steps.jsonl": (0, 1, 2),
    "plans.jsonl": (1, 3),
    "metrics.json": (0, 1, 2),
    "map.safetensors": (1, 2, 5),
    "explored.safetensors": (5,),
    "mesh.ply": (0, 1, 2),
    "ground_truth.npz": (0, 1),
    "curve.csv": (1, 2, 3),
    "survey.npz": (2,),
}
"""Of the readers of a run folder, those that read a file; all where it is not named."""
