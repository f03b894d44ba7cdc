"""Recorded sequences that ask for too much, or name what is not theirs, as cases."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from tests.corpus import hostile
from tests.corpus.cases import Case
from tests.corpus.changes import (
    as_it_is,
    last,
    link_out,
    replaced,
    write,
)
from tests.corpus.commands import commands
from tests.corpus.hostile_scenes import EPS


def recording_cases(paths: dict[str, Path], canary: Path) -> Iterator[Case]:
    """Recorded sequences that name what is not theirs, or that unpack to too much."""
    pictures = {
        "tum": "walk/rgb/0.png", "nerfstudio": "walk/images/000.png", "replica": "walk/results/depth000000.png",
        "sequence": "walk/rgb/000000.png",
    }  # fmt: skip
    for kind, name in pictures.items():
        (argv,) = commands(kind, paths)
        for width, height in ((60_000, 60_000), (2_000_000_000, 1)):
            bomb = partial(write, name, hostile.png(width, height))
            yield Case(f"{kind}: a picture of {width} x {height}", kind, bomb, argv)
        yield Case(f"{kind}: a picture that is EPS", kind, partial(write, name, EPS), argv)
        yield Case(f"{kind}: a picture that is a link out", kind, partial(link_out, name, canary / "secret.png"), argv)
        for option in (
            ("--every", "0"),
            ("--camera", "nan,nan,1,1"),
            ("--camera", "0,0,0,0"),
            ("--depth-unit", "inf"),
            ("--floor", "nan"),
            ("--depth-unit", "-1"),
            ("--radius", "nan"),
            ("--height", "inf"),
            ("--every", str(10**30)),
            ("--layout", "bag"),
        ):
            yield Case(f"{kind}: {' '.join(option)}"[:60], kind, as_it_is, (*argv, *option))
    for outside in (f"{canary}/secret.png", "../../../canary/secret.png", "/dev/zero", "/proc/self/mem"):
        for file in ("rgb.txt", "depth.txt"):
            lines = "".join(f"{time} {outside}\n" for time in range(6)).encode()
            yield Case(
                f"tum: {file} names {last(outside)}",
                "tum",
                partial(write, f"walk/{file}", lines),
                *commands("tum", paths),
            )
        for key in ("file_path", "depth_file_path"):
            change = partial(_frame_entry, key, outside)
            yield Case(f"nerfstudio: {key} is {last(outside)}", "nerfstudio", change, *commands("nerfstudio", paths))
        change = partial(replaced, "walk/metadata.yaml", "walk.db3", outside)
        yield Case(f"bag: the file is {last(outside)}", "bag", change, *commands("bag", paths))
    (argv,) = commands("sequence", paths)
    for label, content in (
        ("of 10^18 numbers", hostile.npy(f"({10**9}, {10**9})")),
        ("of objects", hostile.npy("(48, 64)", "|O")),
        ("of 10^9 numbers", hostile.npy("(100000, 10000)")),
        ("of text", hostile.npy("(48, 64)", "<U1")),
    ):
        yield Case(f"sequence: depth {label}", "sequence", partial(write, "walk/depth/000000.npy", content), argv)
    for label, text in hostile.yaml_bombs().items():
        for kind in ("bag", "mcap"):
            yield Case(f"{kind}: {label}", kind, partial(write, "walk/metadata.yaml", text), *commands(kind, paths))
    for label, content in hostile.mcap_bombs().items():
        yield Case(f"mcap: {label}", "mcap", partial(_alone, content), ("map", "in/alone.mcap", "--out", "out"))
    yield Case("sequence: 10^6 poses", "sequence", partial(write, "walk/poses.tum", b"0 0 0 1 0 0 0 1\n" * 10**6), argv)


def _alone(content: bytes, folder: Path) -> None:
    (folder / "alone.mcap").write_bytes(content)


def _frame_entry(key: str, value: str, folder: Path) -> None:
    path = folder / "walk" / "transforms.json"
    facts = json.loads(path.read_text())
    for frame in facts["frames"]:
        frame[key] = value
    path.write_text(json.dumps(facts))
