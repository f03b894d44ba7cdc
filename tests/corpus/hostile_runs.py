"""Run folders that ask for too much, or lead out of themselves, as cases."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from tests.corpus import hostile
from tests.corpus.cases import Case
from tests.corpus.changes import (
    arrays_of,
    entry,
    link_out,
    moved_out,
    nested_entry,
    write,
)
from tests.corpus.commands import commands


def run_cases(paths: dict[str, Path], canary: Path) -> Iterator[Case]:
    """Run folders, whole and killed.

    Args:
        paths: the good inputs.
        canary: a folder that nothing may read or write.
    """

    def imports(kind: str) -> tuple[str, ...]:
        return commands(kind, paths)[0]

    for width, height in ((60_000, 60_000), (2_000_000_000, 1), (100_000, 100)):
        bomb = partial(write, "run/depth/000000.png", hostile.png(width, height))
        yield Case(f"run: depth of {width} x {height}", "run", bomb, imports("run"))
    names = ("samples", "vertices", "faces")
    yield Case(
        "run: bomb in ground_truth.npz",
        "run",
        partial(arrays_of, "run/ground_truth.npz", hostile.npz_bomb, names),
        imports("run"),
    )
    yield Case(
        "run: pickle in ground_truth.npz",
        "run",
        partial(arrays_of, "run/ground_truth.npz", hostile.pickled_npz, names),
        imports("run"),
    )
    yield Case("run: the folder is a link", "run", partial(_linked_folder), ("eval", "in/link"))
    yield from _links(paths, canary)


def _links(paths: dict[str, Path], canary: Path) -> Iterator[Case]:
    """Run folders whose files are links to what must not be written."""
    for name in ("metrics.json", "curve.csv", "curve.png", "curve.pdf", "curve.svg", "metrics.json.part", "export"):
        for argv in (commands("run", paths)[0], ("export", "in/run", "--format", "all")):
            yield Case(
                f"run: {name} is a link out: {argv[0]}",
                "run",
                partial(link_out, f"run/{name}", canary / "precious"),
                argv,
            )
    yield Case(
        "run: export is a linked folder",
        "run",
        partial(link_out, "run/export", canary),
        ("export", "in/run", "--format", "all"),
    )
    (resume,) = commands("killed", paths)
    for name in (
        *("steps.jsonl", "frames.jsonl", "plans.jsonl", "trajectory.tum", "curve.csv", "resumed.jsonl"),
        *("metrics.json", "map.safetensors", "mesh.ply", "topdown.png", "explored.safetensors", "config.json"),
    ):
        yield Case(
            f"killed: {name} is a link out", "killed", partial(link_out, f"run/{name}", canary / "precious"), resume
        )
    for name in ("depth", "rgb", "plans", "checkpoint"):
        yield Case(f"killed: {name} is a linked folder", "killed", partial(moved_out, f"run/{name}"), resume)
        for below in ("000001.png", "000003.jpg", "000009.npz"):
            link = partial(link_out, f"run/{name}/{below}", canary / "precious")
            yield Case(f"killed: {name}/{below} is a link out", "killed", link, resume)
    for key, value in (
        ("policy", "os:system"), ("policy", "../x:Y"), ("policy", 3), ("scene", "/dev/zero"), ("scene", "/etc"),
        ("scene", 7), ("robot", "/dev/zero"), ("robot", "/etc/passwd"), ("steps", 10**12), ("image_px", 10**9),
        ("drive", "sideways"), ("seed", -1), ("start", [1]), ("continue_from", "/etc"), ("device", "cuda"),
    ):  # fmt: skip
        change = partial(entry, "run/config.json", key, value)
        yield Case(f"killed: config.{key} is {value!r}", "killed", change, resume)
        yield Case(
            f"run: config.{key} is {value!r}",
            "run",
            partial(entry, "run/config.json", key, value),
            commands("run", paths)[5],
        )
    for group, key, value in (
        ("mapping.field", "log2_table_size", 40), ("mapping.field", "num_levels", 10**6),
        ("mapping.schedule", "replay_bytes", 10**15), ("mapping.schedule", "iterations", 10**9),
        ("mapping.occupancy", "voxel_m", 1e-9), ("planning", "margin_m", "x"), ("mapping.sampling", "scheme", []),
        ("record", "images", 7), ("checkpoint", "every_steps", "x"), ("mapping", "surface_lattice_m", 1e-9),
    ):  # fmt: skip
        change = partial(nested_entry, "run/config.json", group, key, value)
        yield Case(f"killed: config.{group}.{key} is {value!r}", "killed", change, resume)


def _linked_folder(folder: Path) -> None:
    (folder / "link").symlink_to("link")
