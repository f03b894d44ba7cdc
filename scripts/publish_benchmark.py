"""Puts the tables, pictures and rows of a finished comparison onto its page of the documentation.

    python scripts/publish_benchmark.py bench/test

writes docs/benchmarks/test.md and, in docs/benchmarks/test/, results.csv as it is, the runs of each start without their
maps, and the pictures with few colours so that they stay small. Of several scenes the page shows pictures, not tables,
which results.csv holds. Of a page that is there only what stands between its marks is replaced.
"""

import io
import json
import re
import tarfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import tyro

from anm_mj.bench.executor import RESULT
from anm_mj.bench.run_result import read_results
from anm_mj.bench.statistics import grouped
from anm_mj.bench.worker import BOUND
from anm_mj.cli.command_line import run_script
from anm_mj.errors import AnmError
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.read_run import read_json
from anm_mj.utils.files import atomic_write, file_name, write_text
from anm_mj.utils.picture import open_picture
from anm_mj.utils.read_file import read_text

PAGES = Path(__file__).resolve().parents[1] / "docs" / "benchmarks"
BEGIN, END = "<!-- results -->", "<!-- /results -->"
COLOURS = 256
SCENE = r"## (\S+)"
"""Heading of the tables of one scene."""
PICTURES = {
    r"## Mean over .*, budget by (\w+)": (("overview_{}", "Mean coverage over scenes, and performance profiles"),),
    r"## Mean over .* policy": (("overview", "Mean coverage over scenes, and performance profiles"),),
    SCENE: (
        ("curves_{}", "Coverage against steps"),
        ("curves_{}_area", "Coverage against steps, budget by area"),
        ("curves_{}_rooms", "Coverage against steps, budget by rooms"),
        ("scene_{}", "Run of median AUC of each policy"),
    ),
}
"""Pictures below each kind of heading of the tables, and what they show."""
WHOLE = (RESULT, "metrics.json", "curve.csv", BOUND)
"""Files that are packed as they are."""
STEP_KEYS = ("action", "x_m", "y_m", "yaw_rad", "collided", "moved_m")
"""Of ``steps.jsonl``, what tables and pictures need, and an oracle that begins from the run."""
PLAN_KEYS = ("ms",)
"""Of ``plans.jsonl``, how long a decision took."""
PRIVATE = ("scene", "command")
"""Of the manifest, what names folders of this machine."""


def main(comparison: Annotated[Path, tyro.conf.Positional], pages: Path = PAGES) -> None:
    """Publish a comparison.

    Args:
        comparison: Folder that ``anm-mj bench`` has written.
        pages: Folder of the page, which is named like the comparison.
    """
    name = comparison.resolve().name
    page = pages / f"{name}.md"
    try:
        table, rows = (read_text(comparison / file) for file in ("table.md", "results.csv"))
        text = read_text(page) if page.exists() else f"# Suite {name}\n\n{BEGIN}\n{END}\n"
    except (OSError, ValueError) as err:
        raise AnmError(f"The tables cannot be published ({err}); give a folder of anm-mj bench.") from err
    if BEGIN in table or END in table:
        raise AnmError(f"{comparison / 'table.md'} holds a mark of {page}; make the tables again.")
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise AnmError(f"{page} holds no marks {BEGIN} and {END}; put them where the results belong.")
    try:
        lines = _with_pictures(without_scene_tables(table.splitlines()), comparison, pages / name)
        write_text(pages / name / "results.csv", rows)
        link = f"A row for every run and budget, scene by scene: [results.csv]({name}/results.csv)."
        link += f"\n{_packed(comparison, pages / name)}"
        write_text(page, f"{before}{BEGIN}\n{link}\n\n" + "\n".join(lines) + f"\n{END}{after}")
    except (OSError, ValueError) as err:
        raise AnmError(f"The results cannot be published ({err}); make them again, or give other --pages.") from err


def without_scene_tables(lines: Sequence[str]) -> list[str]:
    """Lines without the tables of single scenes, where there are several scenes."""
    headings = {line for line in lines if re.fullmatch(SCENE, line)}
    kept, heading = list[str](), ""
    for line in lines:
        heading = line if line.startswith("## ") else heading
        is_cut = len(headings) > 1 and heading in headings and line.startswith("|")
        if not is_cut and not (line == "" and kept[-1:] == [""]):
            kept.append(line)
    return kept


def _packed(comparison: Path, folder: Path) -> str:
    """Write ``start<number>.tar.xz`` into a folder: the runs from each start of a comparison, without maps, pictures
    and most of what their logs say. They replace those of the last time. Returns the links to them.

    Unpacked into the folder of a comparison, they are finished runs of it. The same runs give the same bytes. Raises
    BenchError or RunFolderError if a run is damaged, and OSError if a file cannot be written.
    """
    by_start = grouped((result.job.start, result.folder) for result in read_results(comparison))
    folder.mkdir(parents=True, exist_ok=True)
    packed = []
    for start, runs in sorted(by_start.items()):
        packed.append(folder / f"start{start}.tar.xz")
        with atomic_write(packed[-1]) as partial, tarfile.open(partial, "w:xz", preset=9) as archive:
            for run in runs:
                for name, content in _packed_files(run):
                    entry = tarfile.TarInfo(f"runs/{run.name}/{name}")
                    entry.size = len(content)
                    archive.addfile(entry, io.BytesIO(content))
    for old in set(folder.glob("start*.tar.xz")) - set(packed):
        old.unlink()
    links = [f"[{file.name}]({folder.name}/{file.name})" for file in packed]
    return f"Runs to compare with: {', '.join(links)}."


def _packed_files(run: Path) -> Iterator[tuple[str, bytes]]:
    """Names and contents of what is packed of a run."""
    for name in WHOLE:
        if (run / name).is_file():
            yield name, (run / name).read_bytes()
    if (run / "manifest.json").is_file():
        public = {key: value for key, value in read_json(run / "manifest.json").items() if key not in PRIVATE}
        if "robot" in public:
            # A robot of one's own is named by its file.
            public["robot"] = Path(str(public["robot"])).name
        yield "manifest.json", json.dumps(public, indent=2).encode()
    for name, keys in (("steps.jsonl", STEP_KEYS), ("plans.jsonl", PLAN_KEYS)):
        if (run / name).is_file():
            lines = [{key: line[key] for key in keys if key in line} for line in read_jsonl(run / name)]
            yield name, "".join(json.dumps(line) + "\n" for line in lines).encode()


def _with_pictures(lines: Sequence[str], comparison: Path, pictures: Path) -> list[str]:
    """Lines with links to their pictures, whose small copies replace those of the last time.

    Raises:
        OSError: A picture cannot be read or written.
        ValueError: One is damaged.
    """
    pictures.mkdir(parents=True, exist_ok=True)
    for old in pictures.glob("*.png"):
        old.unlink()
    linked = []
    for line in lines:
        linked.append(line)
        for picture, shows in _pictures_below(line, comparison):
            if (pictures / picture.name).exists():
                continue
            with open_picture(picture) as drawn:
                drawn.convert("RGB").quantize(COLOURS).save(pictures / picture.name, optimize=True)
            linked += ["", f"![{shows}]({pictures.name}/{picture.name})"]
    return linked


def _pictures_below(line: str, comparison: Path) -> list[tuple[Path, str]]:
    """The pictures that belong below a line of the tables, and what they show."""
    for pattern, named in PICTURES.items():
        found = re.fullmatch(pattern, line)
        if found is not None:
            own = [file_name(part) for part in found.groups()]
            paths = [(comparison / f"{stem.format(*own)}.png", shows) for stem, shows in named]
            return [(path, shows) for path, shows in paths if path.is_file()]
    return []


if __name__ == "__main__":
    run_script(main)
