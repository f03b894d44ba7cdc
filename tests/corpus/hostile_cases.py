"""Inputs that ask for too much, climb out of their folder, or name what they should not, as cases."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from tests.corpus.cases import Case
from tests.corpus.changes import as_it_is
from tests.corpus.hostile_bags import bag_cases
from tests.corpus.hostile_recordings import recording_cases
from tests.corpus.hostile_runs import run_cases
from tests.corpus.hostile_scenes import mjcf_cases, scene_cases

ROBOT = Path(__file__).resolve().parents[1] / "rover.xml"
OPTIONS = (
    ("explore",),
    ("explore", ""),
    ("explore", "\0"),
    ("explore", "flat", "--steps", "1e9"),
    ("explore", "flat", "--seed", "9" * 400),
    ("explore", "flat", "--start", "1e300,0,0"),
    ("explore", "flat", "--start", "nan,0,0"),
    ("explore", "flat", "--set", "mapping.voxel_m=1e-9", "--steps", "1", "--out", "out"),
    ("explore", "flat", "--set", "=", "--steps", "1"),
    ("explore", "flat", "--set", "a.b.c.d.e=1"),
    ("explore", "flat", "--policy", "os:system"),
    ("explore", "flat", "--policy", "../../x:Y"),
    ("explore", "flat", "--sensor", "d435i", "--set", "sensor.noise_scale=-1"),
    ("explore", "flat", "--sensor", "nothing"),
    ("explore", "flat", "--robot", "/dev/zero", "--steps", "1", "--out", "out"),
    ("explore", "flat", "--robot", "missing.xml"),
    ("explore", "/dev/null"),
    ("explore", "/etc"),
    ("scene", "generate", "out", "--rooms", "0"),
    ("scene", "generate", "out", "--rooms", "1000000"),
    ("scene", "generate", "out", "--rooms", "-3"),
    ("scene", "generate", "out", "--rooms", "2", "--seed", "-1"),
    ("scene", "import", "/dev/zero", "out"),
    ("scene", "import", "/etc/passwd", "out"),
    ("scene", "import", "/proc/self/mem", "out"),
    ("scene", "check", "/etc"),
    ("scene", "check", "nothing"),
    ("eval", "/etc"),
    ("eval", "nothing"),
    ("eval", "in"),
    ("bench", "/dev/zero", "--out", "out"),
    ("bench", "nothing.toml", "--out", "out"),
    ("bench", "in", "--out", "out"),
)


def hostile_cases(paths: dict[str, Path], canary: Path) -> Iterator[Case]:
    """Bombs, entities, links out of the folder, impossible options.

    Args:
        paths: the good inputs.
        canary: a folder that nothing may read or write.
    """
    for cases in (scene_cases, mjcf_cases, run_cases, recording_cases, bag_cases):
        yield from cases(paths, canary)
    for out in ("in/room.obj", "/dev/null", "in/room.obj/below", "a" * 300, "out\n[red]x[/b]", "-", "/proc/x", "in"):
        yield Case(f"obj: out is {out[:20]!r}", "obj", as_it_is, ("scene", "import", "in/room.obj", out))
    for out in ("in/rover.xml", "/dev/null/x", "a" * 300, "/proc/x", "in"):
        yield Case(f"robot: out is {out[:20]!r}", "robot", as_it_is, ("explore", "flat", "--steps", "1", "--out", out))
    for words in OPTIONS:
        yield Case(f"options: {' '.join(words)[:60]}", "robot", as_it_is, words)
