"""Finished runs of a comparison in a few small files, so that others compare with them and need not make them again."""

import io
import json
import tarfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from anm_mj.bench.executor import RESULT
from anm_mj.bench.run_result import Result, read_results
from anm_mj.bench.worker import BOUND
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.read_run import read_json
from anm_mj.utils.files import atomic_write

WHOLE = (RESULT, "metrics.json", "curve.csv", BOUND)
"""Files that are packed as they are."""
STEP_KEYS = ("action", "x_m", "y_m", "yaw_rad", "collided", "moved_m")
"""Of ``steps.jsonl``, what tables and pictures need, and an oracle that begins from the run."""
PLAN_KEYS = ("ms",)
"""Of ``plans.jsonl``, how long a decision took."""
PRIVATE = ("scene", "command")
"""Of the manifest, what names folders of this machine."""


def pack_runs(comparison: Path, folder: Path) -> list[Path]:
    """Write ``start<number>.tar.xz`` into a folder: the runs from each start of a comparison's folder, without maps,
    pictures and most of what their logs say.

    Unpacked into the folder of a comparison, they are finished runs of it. The same runs give the same bytes. Returns
    the files. Raises BenchError or RunFolderError if a run is damaged, and OSError if a file cannot be written.
    """
    by_start: dict[int, list[Result]] = {}
    for result in read_results(comparison):
        by_start.setdefault(result.job.start, []).append(result)
    folder.mkdir(parents=True, exist_ok=True)
    return [_pack(runs, folder / f"start{start}.tar.xz") for start, runs in sorted(by_start.items())]


def _pack(runs: Sequence[Result], path: Path) -> Path:
    with atomic_write(path) as partial, tarfile.open(partial, "w:xz", preset=9) as archive:
        for run in runs:
            for name, content in _files(run.folder):
                entry = tarfile.TarInfo(f"runs/{run.folder.name}/{name}")
                entry.size = len(content)
                archive.addfile(entry, io.BytesIO(content))
    return path


def _files(run: Path) -> Iterator[tuple[str, bytes]]:
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
