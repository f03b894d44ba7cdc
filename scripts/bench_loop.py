"""Measures what a step of a run costs, stage by stage, beside the least that each stage could cost on this machine.

    python scripts/bench_loop.py home aws_small_house --steps 500
    python scripts/bench_loop.py home --steps 500 --reality real

Each scene is explored as ``anm-mj explore`` does it, recording included. Times are wall milliseconds per step, of a
stage without the stages within it; what other threads do meanwhile stands in a column of its own, and so does processor
time, of all Python threads. That of the threads of training and other compiled loops counts in the last row only. What
a stage costs that does not occur in the run is left out. Floors: of the camera, the time within MuJoCo's renderer; of
training, the multiply-adds and random table accesses of its iterations at the rates measured on one core (as
``scripts/bench_mapper.py``), over the threads; of the occupancy grid, its counts and the field's reading, the bytes
that they must read and write at the memory rate measured on one core. A stage without a figure has no floor that is
known. The first frames, whose training is longer, count too.

A second table says where the rest of the run's wall time goes: setting up, and what is written at the end.
"""

import functools
import json
import os
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.table import Table

from anm_mj.cli.command_line import run_script
from anm_mj.config import make_config
from anm_mj.events import Ended, On
from anm_mj.mapping.mapping_config import MappingConfig
from anm_mj.types import OccupancyGrid

STAGES = {
    "camera": "picture, noise of the sensor and pose",
    "renderer": "within MuJoCo's renderer",
    "sensor": "noise of the depth camera",
    "people": "where they walk",
    "motion": "actions, odometry, contacts",
    "servo": "wheel speeds, mink",
    "physics": "mj_step",
    "localise": "pose of the frame",
    "moved": "pixels that show something moved",
    "monitor": "faults of the camera",
    "occupancy": "carving and marking",
    "counts": "observation counts",
    "keyframes": "keyframe packing",
    "draw": "rays of the batches",
    "train": "training iterations",
    "field read": "the field as geometry",
    "top-down": "columns and distances",
    "graph": "road map",
    "plan": "gains, regions, tours, look-ahead",
    "coverage": "completion curve",
    "record": "logs, depth frames, images",
    "rest": "moves, checks, copies",
}
"""Stages of a step in the order of the table, and what each is."""
AROUND = {
    "set up": "scene, robot, engine, true surface",
    "explore": "the loop",
    "settle": "training at falling rates",
    "survey": "last reading of the map",
    "map file": "map.safetensors",
    "mesh": "extraction and file",
    "completion": "without its cap",
    "mesh quality": "against the true surface",
    "pictures": "curve and top-down map, matplotlib",
    "waiting": "for the thread that searches, draws and writes",
    "other": "everything else",
}
"""Parts of a run in the order of the second table, and what each is."""
IMAGE_BYTES_COUNTS = 4 + 12 + 2 + 64
"""A pixel's depth, ray and count, and the line of memory that its voxel's count lies in."""
VOXEL_BYTES_CARVED = 2 * (1 + 1) + 4
"""A voxel's log-odds and state, read and written, and the depth that it is compared with."""


class Watch:
    """Adds up the time of nested calls, each without those within it; those of other threads by themselves."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        """Of the thread that made the watch."""
        self.beside: dict[str, float] = {}
        """Of all other threads."""
        self.cpu: dict[str, float] = {}
        """Processor time, of all threads."""
        self.calls: dict[str, int] = {}
        self._thread = threading.get_ident()
        self._own = threading.local()

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
        inner = self._own.__dict__.setdefault("inner", [])
        seconds = self.seconds if threading.get_ident() == self._thread else self.beside
        inner.append((0.0, 0.0))
        begin, begin_cpu = time.perf_counter(), time.thread_time()
        try:
            return call()
        finally:
            spent, cpu = time.perf_counter() - begin, time.thread_time() - begin_cpu
            within, cpu_within = inner.pop()
            seconds[stage] = seconds.get(stage, 0.0) + spent - within
            self.cpu[stage] = self.cpu.get(stage, 0.0) + cpu - cpu_within
            self.calls[stage] = self.calls.get(stage, 0) + 1
            if inner:
                outer, outer_cpu = inner[-1]
                inner[-1] = outer + spent, outer_cpu + cpu


@dataclass
class Budget:
    """What the steps of one run cost, and the run around them."""

    scene: str
    steps: int
    hz: float
    """Steps a second, recording included."""
    loop_hz: float
    """Steps a second as ``metrics.json`` has them, without recording."""
    stage_ms: dict[str, float]
    beside_ms: dict[str, float]
    """In other threads meanwhile."""
    cpu_ms: dict[str, float]
    """Processor time in all Python threads."""
    process_ms: float
    """Processor time of the whole process."""
    floor_ms: dict[str, float]
    around_s: dict[str, float]
    """Parts of the run [s]."""
    around_beside_s: dict[str, float]
    """In other threads meanwhile [s]."""
    peak_rss_mib: float


def watched(watch: Watch) -> None:
    """Put the watch on all stages."""
    from anm_mj.sim.gl import select_backend

    select_backend()
    import mujoco

    from anm_mj.control.wheel_servo import BaseServo
    from anm_mj.evaluation.completion_curve import CompletionCurve
    from anm_mj.localisation.field_localiser import FieldLocaliser
    from anm_mj.mapping.backends.native_backend import NativeBackend
    from anm_mj.mapping.depth_occupancy import DepthOccupancy
    from anm_mj.mapping.field_occupancy import FieldOccupancy
    from anm_mj.mapping.keyframes import KeyframeStore
    from anm_mj.mapping.neural_map import NeuralMap
    from anm_mj.people.crowd import Crowd
    from anm_mj.planning.policies.gvg.gvg_policy import Gvg
    from anm_mj.planning.stages import Stages
    from anm_mj.planning.topdown_mapper import TopDownMapper
    from anm_mj.recording.recorder import RunRecorder
    from anm_mj.sensing.sensor_monitor import SensorMonitor
    from anm_mj.sim.drives.physics_drive import PhysicsDrive
    from anm_mj.sim.sensors.camera_sensor import Sensor
    from anm_mj.sim.sim_robot import SimRobot

    for name in ("observe", "anticipate"):
        watch.over(SimRobot, name, "camera")
    watch.over(Sensor, "measure", "sensor")
    watch.over(Crowd, "follow", "people")
    for owner in (SimRobot, PhysicsDrive):
        watch.over(owner, "act", "motion")
    watch.over(BaseServo, "speeds", "servo")
    watch.over(mujoco, "mj_step", "physics")
    watch.over(FieldLocaliser, "localise", "localise")
    watch.over(NeuralMap, "find_moved", "moved")
    for name in ("mjv_updateScene", "mjr_render", "mjr_readPixels"):
        watch.over(mujoco, name, "renderer")
    watch.over(SensorMonitor, "check", "monitor")
    watch.over(DepthOccupancy, "integrate", "occupancy")
    watch.over(DepthOccupancy, "observation_count", "counts")
    watch.over(KeyframeStore, "add", "keyframes")
    watch.over(KeyframeStore, "batches", "draw")
    watch.over(NativeBackend, "steps", "train")
    watch.over(FieldOccupancy, "grid", "field read")
    watch.over(TopDownMapper, "update", "top-down")
    watch.over(Stages, "update_graph", "graph")
    watch.over(Gvg, "plan", "plan")
    watch.over(CompletionCurve, "frame", "coverage")
    for name in ("observation", "step", "plan"):
        watch.over(RunRecorder, name, "record")


def watched_around(watch: Watch) -> None:
    """Put another watch on the parts of a run."""
    import anm_mj.recording.results
    import anm_mj.run
    from anm_mj.mapping.neural_map import NeuralMap
    from anm_mj.recording.recorder import RunRecorder

    watch.over(anm_mj.run, "run_loop", "other")
    watch.over(anm_mj.run, "explore", "explore")
    watch.over(NeuralMap, "finish", "settle")
    watch.over(anm_mj.run, "_what_is_left", "survey")
    watch.over(anm_mj.run, "write_results", "other")
    watch.over(RunRecorder, "flush", "waiting")
    watch.over(NeuralMap, "save", "map file")
    watch.over(NeuralMap, "mesh", "mesh")
    watch.over(anm_mj.recording.results, "write_mesh", "mesh")
    watch.over(anm_mj.recording.results, "without_cap_cm", "completion")
    watch.over(anm_mj.recording.results, "quality_of_mesh", "mesh quality")
    watch.over(anm_mj.recording.results, "_draw", "pictures")
    watch.over(anm_mj.run, "run", "set up")


def measure(scene: str, steps: int, sensor: str | None, reality: str, out: Path) -> Budget:
    """Explore a scene and say where the time went."""
    import anm_mj.run
    from anm_mj.mapping.neural_map import NeuralMap

    watch, around = Watch(), Watch()
    watched(watch)
    watched_around(around)
    maps: list[NeuralMap] = []
    keep = NeuralMap.integrate

    iterations = 0

    def integrate(self: NeuralMap, *args: Any) -> Any:
        nonlocal iterations
        maps[:] = [self]
        update = keep(self, *args)
        iterations += update.num_iterations
        return update

    setattr(NeuralMap, "integrate", integrate)  # noqa: B010 - a plain assignment is a type error.
    # What comes after the loop belongs to no step.
    loop: dict[str, Any] = {}
    explore = anm_mj.run.explore

    def begin(*args: Any, **options: Any) -> Any:
        loop.update(began=(time.perf_counter(), time.process_time()))
        return explore(*args, **options)

    def note(ended: Ended) -> None:
        wall, cpu = loop["began"]
        watch.seconds["rest"] = time.perf_counter() - wall - sum(watch.seconds.values())
        loop.update(seconds=dict(watch.seconds), beside=dict(watch.beside), calls=dict(watch.calls))
        loop.update(cpu=dict(watch.cpu), process_s=time.process_time() - cpu)
        # The map is given back before the run ends.
        loop.update(config=maps[0].config, grid=maps[0].occupancy.by_depth.grid)

    setattr(anm_mj.run, "explore", begin)  # noqa: B010 - as above.
    config = make_config("default", [], scene=scene, policy="gvg", steps=steps, sensor=sensor, reality=reality)
    _, metrics = anm_mj.run.run(config, out=out, observers=(On(Ended, note),))
    seconds, calls = loop["seconds"], loop["calls"]
    frames = calls["occupancy"]
    stage_ms = {name: 1e3 * seconds.get(name, 0.0) / frames for name in STAGES}
    beside_ms = {name: 1e3 * loop["beside"].get(name, 0.0) / frames for name in STAGES}
    renderer_ms = stage_ms["renderer"] + beside_ms["renderer"]
    floor_ms = floors(loop["config"], loop["grid"], iterations / frames, renderer_ms)
    return Budget(
        scene,
        frames - 1,
        frames / sum(seconds.values()),
        metrics.hz or 0.0,
        stage_ms,
        beside_ms,
        {name: 1e3 * loop["cpu"].get(name, 0.0) / frames for name in STAGES},
        1e3 * loop["process_s"] / frames,
        floor_ms,
        {name: around.seconds.get(name, 0.0) for name in AROUND},
        {name: around.beside.get(name, 0.0) for name in AROUND},
        metrics.peak_rss_mib or 0.0,
    )


def floors(config: MappingConfig, grid: OccupancyGrid, iterations: float, renderer_ms: float) -> dict[str, float]:
    """The least milliseconds per step of the stages whose least is known."""
    from bench_mapper import LEVEL_BYTES, step_limit_ms

    from anm_mj import _native

    rates = _native.roofline(LEVEL_BYTES, "")
    cores = len(os.sched_getaffinity(0))
    sampling, schedule = config.sampling, config.schedule
    samples = sampling.samples_per_ray * (schedule.num_rays + schedule.min_current_rays)
    byte_ms = 1e3 / (rates["stream_gb_per_s"] * 1e9)
    # Of the box of everything seen, a view of 90 degrees and the carving range hold at most this.
    seen = min(grid.state.size, int((4.0 / 3.0) * (config.occupancy.carve_range_m / grid.resolution_m) ** 3))
    return {
        "camera": renderer_ms,
        "occupancy": byte_ms * VOXEL_BYTES_CARVED * seen,
        "counts": byte_ms * IMAGE_BYTES_COUNTS * 256 * 256,
        "train": iterations * sum(step_limit_ms(rates, config, samples).values()) / cores,
    }


def main(
    scenes: Annotated[list[str], tyro.conf.Positional],
    steps: int = 300,
    sensor: str | None = None,
    reality: str = "ideal",
    json_file: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
) -> None:
    """Measure and print.

    Args:
        scenes: names or folders of scenes; each is run in a process of its own.
        steps: budget of each run.
        sensor: as of anm-mj explore; None = that of the reality.
        reality: as of anm-mj explore.
        json_file: where the figures go too.
    """
    console = Console(width=120)
    budgets = []
    for scene in scenes:
        budgets.append(in_own_process(scene, steps, sensor, reality))
        print_budget(budgets[-1], console)
    if json_file is not None:
        json_file.write_text(json.dumps([budget.__dict__ for budget in budgets], indent=2) + "\n")


def in_own_process(scene: str, steps: int, sensor: str | None, reality: str) -> Budget:
    """One scene's budget, with caches and memory as of a program that has just started."""
    import multiprocessing

    with tempfile.TemporaryDirectory() as folder, multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(measure, (scene, steps, sensor, reality, Path(folder) / "run"))


def print_budget(budget: Budget, console: Console) -> None:
    """One scene's table."""
    table = Table("stage", "what", "ms a step", "beside it", "processor ms", "floor ms", "times the floor")
    for stage, what in STAGES.items():
        if not (budget.stage_ms[stage] or budget.beside_ms.get(stage)):
            continue
        ms, beside, floor = budget.stage_ms[stage], budget.beside_ms.get(stage, 0.0), budget.floor_ms.get(stage)
        own = ms + budget.stage_ms["renderer"] if stage == "camera" else ms
        share = f"{own / floor:.1f}" if floor else ""
        cpu = f"{budget.cpu_ms[stage]:.2f}" if budget.cpu_ms[stage] else ""
        cells = (f"{beside:.2f}" if beside else "", cpu, "" if floor is None else f"{floor:.2f}", share)
        table.add_row(stage, what, f"{ms:.2f}", *cells)
    table.add_row(
        "all", "", f"{1e3 / budget.hz:.2f}", f"{sum(budget.beside_ms.values()):.2f}", f"{budget.process_ms:.2f}"
    )
    console.print(
        f"\n{budget.scene}: {budget.steps} steps, {budget.hz:.1f} a second, {budget.loop_hz:.1f} without recording; "
        f"{budget.peak_rss_mib:.0f} MiB"
    )
    console.print(table)
    whole = sum(budget.around_s.values()) or 1.0
    parts = Table("part of the run", "what", "s", "share", "beside it, s")
    for part, what in AROUND.items():
        seconds, beside = budget.around_s[part], budget.around_beside_s[part]
        parts.add_row(
            part, what, f"{seconds:.1f}", f"{100.0 * seconds / whole:.0f} %", f"{beside:.1f}" if beside else ""
        )
    console.print(parts)


if __name__ == "__main__":
    run_script(main)
