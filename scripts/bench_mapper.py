"""Measures the mapping engines of this machine side by side, prints one table and writes it as JSON.

Workloads: the paper's training step (2048 rays of 43 samples), a smaller one ("B": 538 rays of 12), the default
preset's (538 rays of 6), five of those with the drawing of their rays from 20 keyframes, 1.6 million SDF queries on a
lattice, and 50,000 points under 20 perturbed decoders. Torch is measured as the engine that it is, with its own gather
and scatter, and "eager": the table is indexed, and autograd computes the gradients. The limit beside the paper's step
("roofline") is made of rates that the script measures on the same core: random reads and updates of a table of one
level's size, multiply-adds on registers, and memory read and written in order.

Times are medians; of one thread CPU time, which other programs on the machine disturb least, of several threads wall
time. Run it pinned (``taskset -c 1 python scripts/bench_mapper.py --threads 1``) and on a quiet machine for numbers to
keep.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from rich.console import Console
from rich.table import Table
from torch import Tensor

from anm_mj import _native
from anm_mj.io.manifest import cpu_model
from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.backends.native_backend import NativeBackend
from anm_mj.mapping.backends.parameters import decoder_shapes
from anm_mj.mapping.backends.torch_backend import TorchBackend
from anm_mj.mapping.keyframes import KeyframeStore
from anm_mj.mapping.mapping_config import MappingConfig, SamplingConfig, paper_mapping
from anm_mj.mapping.rays import RayBatch
from anm_mj.types import Intrinsics, Observation, Pose2

ROOM_M = np.array([10.0, 8.0, 2.8])
LEVEL_BYTES = 1 << 19
"""The table of one level of the common shape."""
BLOB_INPUTS = 9
"""Bins of the one-blob code that are not zero, of 48."""
ENGINES = ["native", "torch", "torch eager"]
NUM_KEYFRAMES = 20
"""In the store that rays are drawn from."""


@dataclass(frozen=True)
class Row:
    """One measurement."""

    workload: str
    engine: str
    threads: int
    runs: int
    median_ms: float
    fastest_ms: float
    clock: str
    """"cpu" or "wall"."""


class EagerTorchBackend(TorchBackend):
    """The torch engine written straight down: the table is indexed, and how back through that is left to autograd."""

    def __init__(self, config: MappingConfig, *, seed: int, device: str = "auto") -> None:
        super().__init__(config, seed=seed, device=device)
        self.field._grid.features = self._features

    @property
    def name(self) -> str:
        """Which engine it is."""
        return "torch eager"

    def _features(
        self, points_m: Float[Tensor, "n 3"], *planes: Float[Tensor, " entries"]
    ) -> Float[Tensor, "n values"]:
        index, weight = self.field._grid.corners(points_m)
        entries = torch.stack(planes, dim=1)[index.long()]
        mixed = (entries * weight[:, :, None]).sum(dim=0)
        return mixed.view(-1, len(points_m), len(planes)).permute(1, 2, 0).reshape(len(points_m), -1)


def room_rays(count: int, rng: np.random.Generator) -> RayBatch:
    """Rays from random places in an empty painted room to its walls, floor and ceiling."""
    origin = (rng.uniform(0.15, 0.85, (count, 3)) * ROOM_M).astype(np.float32)
    yaw = rng.uniform(0.0, math.tau, count)
    direction = np.stack((np.cos(yaw), np.sin(yaw), rng.uniform(-0.7, 0.7, count)), axis=1).astype(np.float32)
    with np.errstate(divide="ignore"):
        exits = np.maximum(-origin / direction, (ROOM_M - origin) / direction)
    depth = exits.min(axis=1).astype(np.float32)
    rgb = 0.5 + 0.3 * np.sin(2.0 * (origin + direction * depth[:, None]))
    return RayBatch(origin, direction, rgb.astype(np.float32), depth)


def measure(workload: str, backend: MapperBackend, threads: int, runs: int, call: Callable[[int], object]) -> Row:
    """Median and fastest of ``runs`` calls, after one to warm up."""
    call(0)
    name = "cpu" if threads == 1 else "wall"
    clock = time.process_time if name == "cpu" else time.perf_counter
    times = []
    for run in range(runs):
        start = clock()
        call(run + 1)
        times.append(1e3 * (clock() - start))
    return Row(workload, backend.name, threads, runs, statistics.median(times), min(times), name)


def lattice_points() -> np.ndarray:
    """400 x 400 x 10 points over the room, as a top-down map asks for."""
    axes = [np.linspace(0.0, extent, n, dtype=np.float32) for extent, n in zip(ROOM_M, (400, 400, 10), strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def noise_view(rng: np.random.Generator) -> Observation:
    """A picture that shows nothing, of the size that a run takes."""
    depth = rng.uniform(0.5, 4.0, (256, 256)).astype(np.float32)
    rgb = rng.integers(256, size=(256, 256, 3), dtype=np.uint8)
    return Observation(
        0, 0.0, rgb, depth, Intrinsics(256, 256, 128.0, 128.0, 128.0, 128.0), np.eye(4), Pose2(0.0, 0.0, 0.0)
    )


def replay_steps(backend: MapperBackend, rng: np.random.Generator) -> Callable[[int], None]:
    """What takes a training step's worth of iterations, from the draw of their rays on."""
    schedule = MappingConfig().schedule
    store = KeyframeStore(schedule.replay_bytes, schedule.pixel_share)
    view = noise_view(rng)
    for _ in range(NUM_KEYFRAMES):
        store.add(view, rng)

    def run(seed: int) -> None:
        batches = store.batches(schedule.iterations, schedule.num_rays, view, schedule.min_current_rays, rng)
        backend.steps(batches, [(seed, None)] * schedule.iterations)

    return run


def bench_engine(make: Callable[[MappingConfig], MapperBackend], threads: int, runs: dict[str, int]) -> list[Row]:
    """All workloads on one engine; those without runs are left out."""
    rng = np.random.default_rng(0)
    paper, default = paper_mapping(), MappingConfig()
    paper = replace(paper, loss=replace(paper.loss, smoothness=0.0))
    backend = make(paper)
    batches = [room_rays(2048, rng) for _ in range(4)]
    rows = [
        measure("paper 2048 x 43, step", backend, threads, runs["paper"], lambda k: backend.step(batches[k % 4], k))
    ]
    small = [room_rays(538, rng) for _ in range(16)]
    doubled = make(replace(default, sampling=SamplingConfig(free_samples=4, near_samples=8)))
    rows.append(measure("B 538 x 12, step", doubled, threads, runs["B"], lambda k: doubled.step(small[k % 16], k)))
    trained = make(default)
    rows.append(measure("default 538 x 6, step", trained, threads, runs["B"], lambda k: trained.step(small[k % 16], k)))
    num_draws = max(1, runs["B"] // 5)
    rows.append(measure("default, 5 steps with draw", trained, threads, num_draws, replay_steps(trained, rng)))
    points = lattice_points()
    if runs["sdf"]:
        rows.append(measure("1.6 M SDF queries", trained, threads, runs["sdf"], lambda _: trained.query_sdf(points)))
    if runs["perturbed"]:
        size = sum(rows_ * cols for rows_, cols in decoder_shapes(default.field).values())
        decoders = (0.1 * rng.standard_normal((20, size))).astype(np.float32)
        some = rng.permutation(points)[:50_000]
        rows.append(
            measure(
                "50 k points x 20 decoders",
                trained,
                threads,
                runs["perturbed"],
                lambda _: trained.query_perturbed(some, decoders),
            )
        )
    return rows


def step_limit_ms(rates: dict[str, float], config: MappingConfig, num_samples: int) -> dict[str, float]:
    """The least time of a training step's parts on one core at the measured rates [ms].

    Counted are eight table reads and eight updates per sample and level; multiply-adds of both decoders forwards and
    twice as many backwards, one-blob inputs by their three bins; and parameters and two moments read and written once.
    Not counted are drawing the samples, finding corners and their weights (twice), the one-blob code, rendering, losses
    and exponentials, for which no rate is measured, so that the limit is out of reach by what they cost.
    """
    field = config.field
    hidden, geometry, grid = field.hidden_width, field.geometry_features, 2 * field.num_levels
    macs = hidden * (grid + BLOB_INPUTS + 1 + geometry) + hidden * (BLOB_INPUTS + geometry + 3)
    # Backwards no gradient is needed by the one-blob code.
    backward = 2 * macs - 2 * hidden * BLOB_INPUTS
    corners = 8 * field.num_levels * num_samples
    adam_bytes = 2 * 3 * 4 * (2 * field.num_levels << field.log2_table_size)
    return {
        "read table": corners * rates["load_ns"] * 1e-6,
        "update table": corners * rates["update_ns"] * 1e-6,
        "decoders": 2.0 * (macs + backward) * num_samples / rates["fma_gflops"] * 1e-6,
        "adam": adam_bytes / rates["stream_gb_per_s"] * 1e-6,
    }


def engine_maker(name: str, kernel: str, threads: int) -> Callable[[MappingConfig], MapperBackend]:
    """What makes an engine with so many threads."""
    if name == "torch eager":
        return lambda config: EagerTorchBackend(config, seed=0, device="cpu")
    if name == "torch":
        return lambda config: TorchBackend(config, seed=0, device="cpu")
    return lambda config: NativeBackend(config, seed=0, num_threads=threads, kernel=kernel)


def print_table(rows: list[Row], console: Console) -> None:
    """All rows, with how many times longer both forms of the torch engine took on as many threads."""
    table = Table("workload", "engine", "threads", "runs", "median ms", "fastest ms", "clock", "torch /", "eager /")
    medians = {(row.workload, row.threads, row.engine): row.median_ms for row in rows}
    for row in rows:
        slower = [medians.get((row.workload, row.threads, name)) for name in ("torch", "torch eager")]
        gains = ["" if value is None else f"{value / row.median_ms:.1f}" for value in slower]
        numbers = (f"{row.median_ms:.2f}", f"{row.fastest_ms:.2f}")
        table.add_row(row.workload, row.engine, str(row.threads), str(row.runs), *numbers, row.clock, *gains)
    console.print(table)


def main() -> int:
    """Measure, print, write; exit status 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--engines", nargs="+", choices=ENGINES, default=ENGINES, help="engines to measure")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2], help="thread counts to measure")
    parser.add_argument(
        "--kernels", nargs="+", default=_native.kernel_names(), help="instruction sets of the native engine"
    )
    parser.add_argument("--runs", type=int, default=15, help="runs per native row; the slow torch rows get fewer")
    parser.add_argument("--out", type=Path, default=Path("bench_mapper.json"), help="where the JSON goes")
    options = parser.parse_args()
    console = Console(width=132)
    native_runs = {"paper": options.runs, "B": 5 * options.runs, "sdf": options.runs, "perturbed": options.runs}
    torch_runs = {"paper": max(3, options.runs // 5), "B": max(3, options.runs // 2), "sdf": 0, "perturbed": 0}
    kernels = options.kernels if "native" in options.engines else []
    rows: list[Row] = []
    with console.status("Measuring"):
        for threads in options.threads:
            torch.set_num_threads(threads)
            for kernel in kernels:
                rows += bench_engine(engine_maker("native", kernel, threads), threads, native_runs)
            for name in ("torch", "torch eager"):
                if name in options.engines:
                    rows += bench_engine(engine_maker(name, "", threads), threads, torch_runs)
        rates = {kernel: _native.roofline(LEVEL_BYTES, kernel) for kernel in kernels}
    print_table(rows, console)
    medians = {(row.workload, row.threads, row.engine): row.median_ms for row in rows}
    limits = {}
    for kernel in kernels:
        parts = step_limit_ms(rates[kernel], paper_mapping(), 2048 * 43)
        limit = sum(parts.values())
        reached = medians.get(("paper 2048 x 43, step", 1, f"native-{kernel}"))
        share = limit / reached if reached else None
        limits[kernel] = {"rates": rates[kernel], "parts_ms": parts, "limit_ms": limit, "reached": share}
        text = ", ".join(f"{name} {value:.1f}" for name, value in parts.items())
        told = "" if share is None else f"; reached: {share:.2f} of it"
        console.print(f"Roofline of the paper's step, {kernel}, one core: {limit:.1f} ms ({text}){told}")
    result = {
        "cpu": cpu_model(),
        "python": sys.version.split()[0],
        "torch": torch.__version__,
        "rows": [asdict(row) for row in rows],
        "roofline": limits,
    }
    options.out.write_text(json.dumps(result, indent=2) + "\n")
    console.print(f"Written to {options.out}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
