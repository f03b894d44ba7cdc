"""The library behind ``import anm_mj``: runs and maps as arrays, explorations from Python, the parts step by step."""

from __future__ import annotations

import base64
import dataclasses
import html
import importlib
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float64

from anm_mj.config import OPTIONS, make_config
from anm_mj.errors import AnmError, ConfigError, MapError, RunFolderError
from anm_mj.io.curve_file import read_curve
from anm_mj.io.read_run import Run, read_json, read_run, titled
from anm_mj.io.run_folder import RunFolder
from anm_mj.planning.policies.registry import DEFAULT_POLICY
from anm_mj.sim.simulation_config import require_choice

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from anm_mj.events import Observer, Stepped
    from anm_mj.mapping.neural_map import NeuralMap


@dataclass(frozen=True)
class Exploration:
    """The outcome of :func:`explore_scene`."""

    folder: Path
    """The run folder."""
    metrics: dict[str, Any]
    """The fields of ``metrics.json``."""

    def __repr__(self) -> str:
        return "\n".join([*_described(RunFolder(self.folder), self.metrics), "more      .metrics, load_run(.folder)"])


@dataclass(frozen=True)
class LoadedRun:
    """A run as arrays; n steps, n + 1 observations, the first before any action."""

    content: Run
    """The records of the folder, one by one."""
    metrics: dict[str, Any]
    """The fields of ``metrics.json``; empty for a run that was killed before its end."""

    def __repr__(self) -> str:
        arrays = "more      .steps, .poses, .curve, .depth_m(step), .plans, .metrics, .config, .plot()"
        return "\n".join([*_described(self.content.folder, self.metrics), arrays])

    def _repr_html_(self) -> str:
        """The same with the top-down map, for notebooks."""
        picture, text = self.content.folder.topdown_picture, f"<pre>{html.escape(repr(self))}</pre>"
        if not picture.is_file():
            return text
        data = base64.b64encode(picture.read_bytes()).decode()
        return f'{text}<img alt="top-down map" style="max-width: 640px" src="data:image/png;base64,{data}">'

    def plot(self, what: Literal["topdown", "curve"] = "topdown") -> Figure:
        """A figure that notebooks show; ``savefig`` writes it.

        Args:
            what: the top-down map with graph and trajectory, or completion against steps.

        Raises:
            ConfigError: there is no such figure.
            RunFolderError: the run has none.
        """
        require_choice("figure", what, ("topdown", "curve"))
        from anm_mj.export.figures import curve_of, topdown_of

        return (curve_of if what == "curve" else topdown_of)(self.content)

    @property
    def config(self) -> dict[str, Any]:
        """The effective configuration."""
        return self.content.config

    @property
    def manifest(self) -> dict[str, Any]:
        """What made the run: versions, machine, scene, seed."""
        return self.content.manifest

    @property
    def plans(self) -> tuple[dict[str, Any], ...]:
        """The decisions, as in ``plans.jsonl``."""
        return self.content.plans

    @cached_property
    def steps(self) -> dict[str, np.ndarray]:
        """One array of length n per quantity of the steps.

        ``step``, ``action`` (names), ``x_m``, ``y_m``, ``yaw_rad``, ``collided``, ``moved_m``, ``left_radps``,
        ``right_radps``, and the time of each stage as ``ms_<stage>``.
        """
        steps = self.content.steps
        columns: dict[str, np.ndarray] = {
            "step": np.array([step.step for step in steps], np.int64),
            "action": np.array([step.action for step in steps]),
            "collided": np.array([step.collided for step in steps], bool),
        }
        names = ("x_m", "y_m", "yaw_rad", "moved_m", "left_radps", "right_radps")
        values = {name: [getattr(step, name) for step in steps] for name in names}
        for stage in dict.fromkeys(stage for step in steps for stage in step.ms):
            values[f"ms_{stage}"] = [step.ms.get(stage, np.nan) for step in steps]
        return columns | {name: np.array(column, np.float64) for name, column in values.items()}

    @cached_property
    def poses(self) -> Float64[np.ndarray, "m 3"]:
        """Poses of the base at the observations, as the robot believed them: x [m], y [m], yaw [rad] in the world."""
        poses = [frame.pose for frame in self.content.frames]
        return np.array([[pose.x_m, pose.y_m, pose.yaw_rad] for pose in poses], np.float64).reshape(-1, 3)

    @cached_property
    def T_world_camera(self) -> Float64[np.ndarray, "m 4 4"]:
        """Poses of the camera at the observations, as the robot believed them (x right, y down, z forward)."""
        return np.array([frame.T_world_camera for frame in self.content.frames], np.float64).reshape(-1, 4, 4)

    @cached_property
    def curve(self) -> dict[str, np.ndarray]:
        """Completion against steps: the columns of ``curve.csv``; NaN where unknown. Raises RunFolderError if the file
        holds no curve.
        """
        return read_curve(self.content.folder.curve)

    def depth_m(self, step: int) -> np.ndarray:
        """Reduced depth of the observation after ``step`` actions, or of a recorded frame by its number [m]; NaN where
        nothing was measured. Raises RunFolderError if there is none, or the image is missing or damaged.
        """
        frame = next((frame for frame in self.content.frames if frame.step == step), None)
        if frame is None:
            raise RunFolderError(f"{self.content.folder.path} has no observation {step}; its frames.jsonl names all.")
        depth_mm = self.content.depth_mm(frame)
        return np.where(depth_mm > 0, depth_mm / np.float32(1e3), np.float32(np.nan)).astype(np.float32)

    def data_frame(self) -> Any:
        """The steps as a ``pandas.DataFrame``. Raises AnmError if pandas is not installed."""
        try:
            pandas = importlib.import_module("pandas")
        except ImportError as err:
            raise AnmError("A data frame needs pandas; pip install pandas, or use the arrays in steps.") from err
        return pandas.DataFrame(self.steps)


def _described(folder: RunFolder, metrics: dict[str, Any]) -> list[str]:
    """What a run is, where it lies, what it came to, and how good its mesh is: a line each."""
    mesh = {"accuracy {:.2f} cm": "accuracy_cm", "F-score {:.1f} %": "observed_f_score"}
    known = [form.format(metrics[key]) for form, key in mesh.items() if metrics.get(key) is not None]
    run, *came_to = titled(folder, metrics).split("\n")
    # The mapping of a recorded sequence has no stop reason.
    ended = [str(metrics.get("stop_reason") or "not ended")] if "stop_reason" in metrics or not metrics else []
    return [
        f"run       {run}",
        f"folder    {folder.path}",
        f"came to   {', '.join([*came_to, *ended])}",
        f"mesh      {', '.join(known) or 'not compared with the truth'}",
    ]


def explore_scene(
    scene: str | os.PathLike[str],
    *,
    policy: str = DEFAULT_POLICY,
    steps: int | None = None,
    seed: int = 0,
    out: str | os.PathLike[str] | None = None,
    preset: str = "default",
    sensor: str | None = None,
    people: int | None = None,
    settings: str | Sequence[str] = (),
    on_step: Callable[[Stepped], object] | None = None,
    observers: Sequence[Observer] = (),
    continue_from: str | os.PathLike[str] | None = None,
    return_to_start: bool = False,
    **options: Any,
) -> Exploration:
    """Explore a scene and write a run folder, as ``anm-mj explore`` does.

    Args:
        scene: name from the catalogue, or path of a scene folder.
        policy: name of a policy, or ``module:Class``.
        steps: budget of discrete actions; None = the scene's own.
        seed: of everything random.
        out: the run folder; None = a new one below ``runs/``.
        preset: mapping effort.
        sensor: errors of the camera, by name; None = none, or those of the reality.
        people: number of people who walk through the scene; None = nobody, or those of the reality.
        settings: ``group.name=value``, or several of them, as for ``--set``.
        on_step: called after every step; the run ends (``INTERRUPTED``) when it returns True.
        observers: hear every event of the run (:mod:`anm_mj.events`), such as a viewer.
        continue_from: folder of a run whose map and explored state this one begins with; None = with nothing.
        return_to_start: whether the robot drives back to its start before the run ends, in time for the budget.
        **options: ``start`` (x [m], y [m], yaw [deg]), ``unknown_start``, ``reality``, ``robot``, ``drive``, ``pose``,
            ``goal``, ``budget``, ``device`` and ``image_px``, as on the command line.

    Raises:
        AnmError: the scene, start, policy, an option or setting, the renderer or the output folder cannot be used.
    """
    from anm_mj.events import On, Stepped
    from anm_mj.run import run

    texts = [settings] if isinstance(settings, str) else settings
    _refuse_wrong(out=out, settings=texts, on_step=on_step, observers=observers)
    known = (*OPTIONS, "image_px", "sensor", "people")
    for name, value in options.items():
        if name not in known:
            raise ConfigError(
                f"{name} is {value!r}, but explore_scene has no such option; it has {', '.join(known)}, and settings "
                "for all else, as in settings=['record.images=full']."
            )
    config = make_config(
        preset,
        [*([] if people is None else [f"people.number={people}"]), *texts],
        sensor=sensor,
        scene=scene,
        policy=policy,
        steps=steps,
        seed=seed,
        continue_from=continue_from,
        return_to_start=return_to_start,
        **options,
    )
    followers = [*observers, *([] if on_step is None else [On(Stepped, on_step)])]
    folder, metrics = run(config, out=None if out is None else Path(out), observers=followers)
    return Exploration(folder.path, dataclasses.asdict(metrics))


def _refuse_wrong(*, out: Any, settings: Any, on_step: Any, observers: Any) -> None:
    """Raises ConfigError for arguments of :func:`explore_scene` that would fail when the run has begun."""
    from anm_mj.events import Observer

    for name, value, is_right, wanted in (
        ("out", out, out is None or isinstance(out, str | os.PathLike), "the path of a folder"),
        ("settings", settings, _all_are(str, settings), "texts, as in ['planning.margin_m=0.06']"),
        ("on_step", on_step, on_step is None or callable(on_step), "a function of one argument"),
        ("observers", observers, _all_are(Observer, observers), "a list of objects with a method on_event"),
    ):
        if not is_right:
            raise ConfigError(f"{name} is {value!r}; give {wanted}.")


def _all_are(kind: type, values: Any) -> bool:
    return isinstance(values, Sequence) and all(isinstance(value, kind) for value in values)


def load_run(path: str | os.PathLike[str]) -> LoadedRun:
    """A run as arrays; one that was killed is read up to its last complete line.

    Args:
        path: the run folder.

    Raises:
        RunFolderError: the folder holds no run, or a file in it is damaged.
    """
    run = read_run(Path(path))
    return LoadedRun(run, read_json(run.folder.metrics) if run.folder.metrics.is_file() else {})


def load_map(path: str | os.PathLike[str], *, device: str = "auto") -> NeuralMap:
    """The neural map of a run: ``sdf``, ``rgb`` and ``uncertainty`` at points, ``render``, ``mesh``, ``occupancy``.

    Args:
        path: the run folder, or the file of a map.
        device: where a map of the torch engine computes: ``auto``, ``cpu`` or ``cuda``.

    Raises:
        MapError: there is no map, or the file is none.
    """
    from anm_mj.mapping.neural_map import NeuralMap

    where = Path(path)
    if not where.exists():
        raise MapError(f"{where} does not exist; give a run folder, or the map.safetensors in one.")
    return NeuralMap.load(RunFolder(where).map if where.is_dir() else where, device=device)
