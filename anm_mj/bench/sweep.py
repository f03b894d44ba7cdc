"""The file of a comparison: a small TOML file that becomes a list of runs (``docs/benchmarks.md`` shows one).

Keys outside of a sweep hold for all ``[[sweep]]``; a file without sweeps is one sweep itself. Every run is one scene,
one policy, one robot, drive, pose and sensor, one start and one seed. Scenes may be ``[[generated]]``,
``[[imported]]``, or those of a ``suite`` (:mod:`anm_mj.bench.suite`).
"""

import itertools
import math
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_type_hints

from anm_mj.bench.job import CONDITIONS, Job
from anm_mj.bench.suite import GeneratedScene, ImportedScene, find_imported, provide, suite_file
from anm_mj.config import BUDGETS
from anm_mj.errors import BenchError
from anm_mj.evaluation.oracle.tour_annealing import MEASURES
from anm_mj.planning.policies.registry import needs_truth, policy_hash
from anm_mj.robot.robot_presets import robot_path
from anm_mj.scene.budget import default_steps
from anm_mj.scene.folder import Scene, load_scene
from anm_mj.sim.simulation_config import IDEAL, reality_of
from anm_mj.utils.close_names import close_name
from anm_mj.utils.file_limits import limit
from anm_mj.utils.files import file_name
from anm_mj.utils.read_file import convert, read_toml


@dataclass(frozen=True)
class Sweep:
    """Scenes times policies times starts times seeds, and the rest of a run's configuration."""

    scenes: list[str]
    """Names from the catalogue, or paths of scene folders, relative to the file."""
    policies: list[str]
    """Names of policies, or ``module:Class``; the module lies beside the file or where the command is given."""
    starts: int = 1
    """Number of start poses of each scene, from the first on."""
    seeds: tuple[int, ...] = (0,)
    """Seeds of the runs."""
    steps: int | None = None
    """Budget of each run; None = the one that ``budget`` names."""
    budget: str = "scene"
    """``scene``: the scene's own, or else by its floor; ``area``: by its floor; ``rooms``: the paper's, by its number
    of rooms; ``both``: the longer of the area's and the paper's, and the tables have each run cut at both."""
    preset: str = CONDITIONS["preset"]
    """Of the map, as ``anm-mj explore --preset`` has it."""
    reality: str = CONDITIONS["reality"]
    """``ideal``, ``real`` or a list of both, as of ``anm-mj explore``; what is given beside it goes before it."""
    sensor: tuple[str, ...] = (CONDITIONS["sensor"],)
    """Names of the sensors whose errors are simulated; one or a list of them."""
    robot: tuple[str, ...] = (CONDITIONS["robot"],)
    """Names of builtin robots, or MJCF files, relative to the file; one or a list of them."""
    drive: tuple[str, ...] = (CONDITIONS["drive"],)
    """``kinematic``, ``physics``, or a list of both."""
    pose: tuple[str, ...] = (CONDITIONS["pose"],)
    """``true``, ``odometry``, ``slam``, or a list of these."""
    goal: tuple[str, ...] = (CONDITIONS["goal"],)
    """What the runs are for: ``coverage``, ``reconstruction``, ``both`` in this order, or a list of these."""
    views: bool = True
    """Whether finished maps are judged by novel and by 200 fixed views: as long as a short run takes."""
    maps: bool = True
    """Whether a map is trained for policies that ask it nothing, too; without, they take half the time and their rows
    have no mesh."""
    settings: tuple[str, ...] = ()
    """Settings as for ``anm-mj explore --set``, for all runs."""


AXES = ("robot", "drive", "pose", "sensor", "goal")
"""Conditions that a sweep varies; one value may stand without a list."""
TYPES = get_type_hints(Sweep)
"""Keys of a sweep and their types."""
MAX_RUNS = limit("ANM_MJ_MAX_RUNS", 10_000)
"""Most runs of a comparison."""


def read_jobs(path: Path, more_policies: Sequence[str] = ()) -> list[Job]:
    """The runs of a file, scene by scene, each once. ``more_policies`` stand beside those that each sweep names; sweeps
    with settings of their own go without.

    Raises:
        BenchError: The file cannot be read, or asks for something that does not exist.
        SceneError: A scene cannot be found or read.
        PlanError: There is no such policy.
        ConfigError: There is no such preset, drive, pose or setting.
        RobotError: There is no such robot or sensor.
    """
    jobs: dict[str, Job] = {}
    scenes: dict[str, Scene] = {}
    hashes: dict[str, str] = {}
    sweeps, provided = read_sweeps(path)
    lists = ("scenes", "policies", "seeds", *AXES)
    num_runs = sum(max(each.starts, 1) * math.prod(len(getattr(each, key)) for key in lists) for each in sweeps)
    if num_runs > MAX_RUNS:
        raise BenchError(f"{path} asks for {num_runs} runs, but they end at {MAX_RUNS}; set ANM_MJ_MAX_RUNS for more.")
    for sweep in sweeps:
        if sweep.settings == reality_of(sweep.reality).texts:
            sweep = replace(sweep, policies=list(dict.fromkeys((*sweep.policies, *more_policies))))
        modules = {policy: policy_hash(policy) for policy in sweep.policies}
        for name in sweep.scenes:
            scene = _scene(path, name, provided.get(name))
            other = scenes.setdefault(file_name(scene.name), scene)
            if (scene.name, scene.hash) != (other.name, other.hash):
                raise BenchError(
                    f"The scenes {scene.name!r} ({scene.folder}) and {other.name!r} ({other.folder}) would share the "
                    "names of their results; change the name in one's scene.toml, or compare them apart."
                )
            # A robot's file may lie beside the comparison's.
            files = {robot: path.parent / robot for robot in sweep.robot}
            robots = [str(file.resolve()) if os.path.isfile(file) else robot for robot, file in files.items()]
            hashes |= {robot: _robot_hash(robot) for robot in robots if robot not in hashes}
            _require_apart(hashes)
            for job in _jobs_in(replace(sweep, robot=tuple(robots)), str(scene.folder), scene):
                job.config()
                own = replace(job, robot_hash=hashes[job.robot], policy_hash=modules[job.policy])
                jobs[own.name] = own
    return list(jobs.values())


def _robot_hash(robot: str) -> str:
    """Of a robot's file; empty for a name. Raises RobotError if there is no such robot, or its file cannot be read."""
    from anm_mj.sim.describe_file import file_hash

    path = robot_path(robot)
    return file_hash(path) if os.path.isfile(robot) else ""


def _require_apart(hashes: Mapping[str, str]) -> None:
    """Raises BenchError where robots of one file name differ; ``hashes`` by robot."""
    first: dict[str, str] = {}
    for robot, found in hashes.items():
        other = first.setdefault(Path(robot).name, robot)
        if hashes[other] != found:
            raise BenchError(f"The robots {other} and {robot} would share the names of their results; rename one file.")


def _scene(path: Path, name: str, entry: GeneratedScene | ImportedScene | None) -> Scene:
    """The scene of a name: generated, imported, beside the comparison's file, or of the catalogue."""
    if isinstance(entry, GeneratedScene):
        return provide(entry)
    if isinstance(entry, ImportedScene):
        return find_imported(entry)
    beside = path.parent / name
    return load_scene(str(beside) if os.path.isfile(beside / "scene.toml") else name)


def read_sweeps(path: Path) -> tuple[list[Sweep], dict[str, GeneratedScene | ImportedScene]]:
    """The sweeps of a file, and the scenes that it or the suite it names says how to make, by name. Raises BenchError
    if the file cannot be read, an entry is not what it should be, or there is no such suite.
    """
    try:
        content = read_toml(path)
    except FileNotFoundError as err:
        raise BenchError(f"There is no file {path}; give a TOML file with scenes and policies.") from err
    except (OSError, ValueError) as err:
        raise BenchError(f"{path} cannot be read ({err}); give a TOML file with scenes and policies.") from err
    _require_known(path, content, (*TYPES, "sweep", "suite", "generated", "imported"))
    suite = content.pop("suite", None)
    provided = {} if suite is None else read_sweeps(suite_file(str(suite)))[1]
    for key, kind, needed in (
        ("generated", GeneratedScene, "name, rooms and seed"),
        ("imported", ImportedScene, "name, repository, commit, file and licence"),
    ):
        try:
            provided |= {scene.name: scene for scene in convert(content.pop(key, []), list[kind])}
        except ValueError as err:
            raise BenchError(f"{path}: {key}{err}; give {needed} of each scene.") from err
    common = {key: value for key, value in content.items() if key != "sweep"}
    sweeps = content.get("sweep", [{}])
    if not isinstance(sweeps, list) or not all(isinstance(sweep, dict) for sweep in sweeps):
        raise BenchError(f"{path}: sweep must be a list of tables; write [[sweep]] above each.")
    if not sweeps:
        raise BenchError(f"{path}: sweep is empty, so that there is nothing to run; give one, or leave it out.")
    return [one for sweep in sweeps for one in _in_each_reality(path, {**common, **sweep})], provided


def _in_each_reality(path: Path, entries: dict[str, Any]) -> list[Sweep]:
    """A sweep for each reality that its entries name, with its conditions and settings below those that are given."""
    _require_known(path, entries, TYPES)
    for needed in ("scenes", "policies"):
        if not entries.get(needed):
            raise BenchError(f"{path}: {needed} is missing; name at least one.")
    named = entries.get("reality", IDEAL)
    found = []
    for name in named if isinstance(named, list) and named else [named]:
        world = reality_of(_entry(path, "reality", name))
        settings = [*world.texts, *_entry(path, "settings", entries.get("settings", []))]
        keys = {**world.options, **entries, "reality": name, "settings": settings}
        found.append(Sweep(**{key: _entry(path, key, value) for key, value in keys.items()}))
    return found


def _require_known(path: Path, keys: Iterable[str], known: Collection[str]) -> None:
    """Raises BenchError for a key that is not known."""
    for key in keys:
        if key not in known:
            raise BenchError(f"{path}: there is no '{key}'{close_name(key, known)}; there are {', '.join(known)}.")


def _entry(path: Path, key: str, value: Any) -> Any:
    """The value of a key of a sweep; raises BenchError for another type."""
    try:
        found = convert([value] if key in AXES and isinstance(value, str) else value, TYPES[key])
    except ValueError as err:
        raise BenchError(f"{path}: {key} is {value!r}, not of its type ({str(err).lower()}).") from err
    if found == () and key != "settings":
        raise BenchError(f"{path}: {key} is empty; name at least one, or leave it out.")
    return found


def _jobs_in(sweep: Sweep, where: str, scene: Scene) -> list[Job]:
    if not 1 <= sweep.starts <= len(scene.starts):
        raise BenchError(
            f"starts is {sweep.starts}, but scene {scene.name} names {len(scene.starts)} start poses; give 1 to that."
        )
    steps, cuts = _budget(sweep, scene)
    shared = {key: getattr(sweep, key) for key in ("preset", "reality", "views", "maps", "settings")}
    jobs = [
        Job(
            scene=where,
            scene_name=scene.name,
            scene_hash=scene.hash,
            policy=policy,
            start=start,
            start_pose=(pose.x_m, pose.y_m, math.degrees(pose.yaw_rad)),
            seed=seed,
            steps=steps,
            cuts=cuts,
            **shared,
            **dict(zip(AXES, values, strict=True)),
        )
        for start, pose in enumerate(scene.starts[: sweep.starts])
        for policy in sweep.policies
        for values in itertools.product(*(getattr(sweep, axis) for axis in AXES))
        for seed in sweep.seeds
    ]
    return [one for job in jobs for one in (_tours(job) if needs_truth(job.policy) else [job])]


def _tours(job: Job) -> list[Job]:
    """The runs of an oracle: a tour for each budget and each measure, because it knows what it is judged by."""
    cuts = job.cuts or (("", job.steps),)
    by_budget = [replace(job, steps=steps, cuts=((name, steps),) if name else ()) for name, steps in cuts]
    if any(setting.startswith("policy.measure=") for setting in job.settings):
        return by_budget
    return [
        replace(one, settings=(*one.settings, f"policy.measure={measure}")) for one in by_budget for measure in MEASURES
    ]


def _budget(sweep: Sweep, scene: Scene) -> tuple[int, tuple[tuple[str, int], ...]]:
    """Steps of the runs in a scene, and the budgets by name that the tables cut them at, if there are several. Raises
    BenchError if there is no such budget.
    """
    if sweep.budget not in (*BUDGETS, "both"):
        raise BenchError(f"budget is {sweep.budget!r}; give {', '.join(BUDGETS)} or both.")
    if sweep.steps is not None:
        return sweep.steps, ()
    if sweep.budget == "scene":
        return default_steps(scene), ()
    rules = ("area", "rooms") if sweep.budget == "both" else (sweep.budget,)
    cuts = tuple((rule, default_steps(scene, rule)) for rule in rules)
    return max(steps for _, steps in cuts), cuts
