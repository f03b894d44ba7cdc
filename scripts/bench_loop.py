"""Measures what a step of a run costs, stage by stage, beside the least that each stage could cost on this machine.

    python scripts/bench_loop.py home aws_small_house --steps 300

Each scene is explored as ``anm-mj explore`` does it, recording included. Times are wall milliseconds per step, of a
stage without the stages within it. Floors: of the camera, the time within MuJoCo's renderer; of training, the multiply
-adds and random table accesses of its iterations at the rates measured on one core (as ``scripts/bench_mapper.py``),
over the threads; of the occupancy grid, its counts and the field's reading, the bytes that they must read and write at
the memory rate measured on one core. A stage without a figure has no floor that is known. The first frames, whose
training is longer, count too.
"""

import functools
import json
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.table import Table

from anm_mj.config import make_config

STAGES = {
    "camera": "picture, noise of the sensor and pose",
    "renderer": "within MuJoCo's renderer",
    "occupancy": "carving and marking",
    "counts": "observation counts",
    "keyframes": "keyframe packing",
    "draw": "rays of the batches",
    "train": "training iterations",
    "field read": "the field as geometry",
    "plan": "decisions and look-ahead",
    "record": "curve, files, depth frames",
    "rest": "moves, checks, copies",
}
"""Stages in the order of the table, and what each is."""
IMAGE_BYTES_COUNTS = 4 + 12 + 2 + 64
"""A pixel's depth, ray and count, and the line of memory that its voxel's count lies in."""
VOXEL_BYTES_CARVED = 2 * (1 + 1) + 4
"""A voxel's log-odds and state, read and written, and the depth that it is compared with."""


@dataclass
class Watch:
    """Adds up the time of nested calls, each without those within it."""

    seconds: dict[str, float] = field(default_factory=dict)
    calls: dict[str, int] = field(default_factory=dict)
    _inner: list[float] = field(default_factory=list)

    def over(self, owner: Any, name: str, stage: str) -> None:
        """Time a function of a class or module from now on."""
        found: Any = getattr(owner, name)
        function: Any = found.fget if isinstance(found, property) else found

        @functools.wraps(function)
        def timed(*args: Any, **options: Any) -> Any:
            return self.run(stage, lambda: function(*args, **options))

        setattr(owner, name, property(timed) if isinstance(owner.__dict__.get(name), property) else timed)

    def run(self, stage: str, call: Callable[[], Any]) -> Any:
        """Time one call."""
        self._inner.append(0.0)
        begin = time.perf_counter()
        try:
            return call()
        finally:
            spent = time.perf_counter() - begin
            self.seconds[stage] = self.seconds.get(stage, 0.0) + spent - self._inner.pop()
            self.calls[stage] = self.calls.get(stage, 0) + 1
            if self._inner:
                self._inner[-1] += spent


@dataclass
class Budget:
    """What the steps of one run cost."""

    scene: str
    steps: int
    hz: float
    stage_ms: dict[str, float]
    floor_ms: dict[str, float]


def watched(watch: Watch) -> None:
    """Put the watch on all stages."""
    from anm_mj.sim.gl import select_backend

    select_backend()
    import mujoco

    import anm_mj.run
    from anm_mj.io.recorder import RunRecorder
    from anm_mj.mapping.backends.native_backend import NativeBackend
    from anm_mj.mapping.field_geometry import FieldGeometry
    from anm_mj.mapping.keyframes import KeyframeStore
    from anm_mj.mapping.occupancy import OccupancyGrid
    from anm_mj.planning.policies.gvg.policy import Gvg
    from anm_mj.sim.robot import SimRobot

    watch.over(SimRobot, "observe", "camera")
    for name in ("mjv_updateScene", "mjr_render", "mjr_readPixels"):
        watch.over(mujoco, name, "renderer")
    watch.over(OccupancyGrid, "integrate", "occupancy")
    watch.over(OccupancyGrid, "observation_count", "counts")
    watch.over(KeyframeStore, "add", "keyframes")
    watch.over(KeyframeStore, "batches", "draw")
    watch.over(NativeBackend, "step", "train")
    watch.over(FieldGeometry, "grid", "field read")
    watch.over(Gvg, "plan", "plan")
    for name in ("observation", "step", "plan"):
        watch.over(RunRecorder, name, "record")
    watch.over(anm_mj.run, "explore", "rest")


def measure(scene: str, steps: int, sensor: str, out: Path) -> Budget:
    """Explore a scene and say where the time went."""
    from anm_mj.mapping.neural_map import NeuralMap
    from anm_mj.run import run

    watch = Watch()
    watched(watch)
    maps: list[NeuralMap] = []
    keep = NeuralMap.integrate

    def integrate(self: NeuralMap, *args: Any) -> Any:
        maps[:] = [self]
        return keep(self, *args)

    setattr(NeuralMap, "integrate", integrate)  # noqa: B010 - a plain assignment is a type error.
    config = make_config("default", [], scene=scene, policy="gvg", steps=steps, sensor=sensor)
    run(config, out=out)
    frames = watch.calls["occupancy"]
    total = sum(watch.seconds.values())
    stage_ms = {name: 1e3 * watch.seconds.get(name, 0.0) / frames for name in STAGES}
    floor_ms = floors(maps[0], watch.calls["train"] / frames, stage_ms)
    return Budget(scene, frames - 1, frames / total, stage_ms, floor_ms)


def floors(mapper: Any, iterations: float, stage_ms: dict[str, float]) -> dict[str, float]:
    """The least milliseconds per step of the stages whose least is known."""
    from bench_mapper import LEVEL_BYTES, step_limit_ms

    from anm_mj.mapping.backends.native_backend import roofline

    rates = roofline(LEVEL_BYTES)
    config, cores = mapper.config, len(os.sched_getaffinity(0))
    sampling, schedule = config.sampling, config.schedule
    samples = sampling.samples_per_ray * (schedule.num_rays + schedule.min_current_rays)
    byte_ms = 1e3 / (rates["stream_gb_per_s"] * 1e9)
    grid = mapper.observed.grid
    # Of the box of everything seen, a view of 90 degrees and the carving range hold at most this.
    seen = min(grid.state.size, int((4.0 / 3.0) * (config.occupancy.carve_range_m / grid.resolution_m) ** 3))
    return {
        "camera": stage_ms["renderer"],
        "renderer": stage_ms["renderer"],
        "occupancy": byte_ms * VOXEL_BYTES_CARVED * seen,
        "counts": byte_ms * IMAGE_BYTES_COUNTS * 256 * 256,
        "train": iterations * sum(step_limit_ms(rates, config, samples).values()) / cores,
    }


def main(
    scenes: Annotated[list[str], tyro.conf.Positional],
    steps: int = 300,
    sensor: str = "exact",
    json_file: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
) -> None:
    """Measure and print.

    Args:
        scenes: names or folders of scenes; each is run in a process of its own.
        steps: budget of each run.
        sensor: as of anm-mj explore.
        json_file: where the figures go too.
    """
    console = Console(width=120)
    budgets = []
    for scene in scenes:
        budgets.append(in_own_process(scene, steps, sensor))
        print_budget(budgets[-1], console)
    if json_file is not None:
        json_file.write_text(json.dumps([budget.__dict__ for budget in budgets], indent=2) + "\n")


def in_own_process(scene: str, steps: int, sensor: str) -> Budget:
    """One scene's budget, with caches and memory as of a program that has just started."""
    import multiprocessing

    with tempfile.TemporaryDirectory() as folder, multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(measure, (scene, steps, sensor, Path(folder) / "run"))


def print_budget(budget: Budget, console: Console) -> None:
    """One scene's table."""
    table = Table("stage", "what", "ms a step", "floor ms", "times the floor")
    for stage, what in STAGES.items():
        ms, floor = budget.stage_ms[stage], budget.floor_ms.get(stage)
        share = f"{ms / floor:.1f}" if floor and stage != "renderer" else ""
        table.add_row(stage, what, f"{ms:.2f}", "" if floor is None else f"{floor:.2f}", share)
    table.add_row("all", "", f"{1e3 / budget.hz:.2f}")
    console.print(f"\n{budget.scene}: {budget.steps} steps, {budget.hz:.1f} a second, recording included")
    console.print(table)


if __name__ == "__main__":
    tyro.cli(main)
