"""The logs of a run, written as it goes."""

import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8, UInt16
from PIL import Image

from anm_mj.ground_truth.reduced_depth import EVALUATION_SIDE_PX, reduce_depth
from anm_mj.io.jsonl import LineWriter
from anm_mj.io.plan_file import write_plan
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.sequence_poses import base_line
from anm_mj.io.to_json import write_json
from anm_mj.io.write import writing
from anm_mj.localisation.localiser import PoseEstimate, TrackingState
from anm_mj.recording.record_config import RecordConfig
from anm_mj.types import ActionResult, MapUpdate, Observation, Plan, Pose2, TrueView
from anm_mj.utils.files import removed_on_error

SMALL_QUALITY, FULL_QUALITY = 80, 95
"""JPEG quality of small and of full images."""


class RunLog:
    """Writes observations, actions and decisions of a run, or of a recorded sequence; of a new one, or of one that
    ``goes_on`` once its logs are :meth:`cut`. Every method raises RunFolderError if the folder cannot be written.
    """

    REBUILT = ("_folder", "_record", "_steps", "_plans", "_frames", "_trajectory")

    def __init__(self, folder: RunFolder, record: RecordConfig, *, goes_on: bool = False) -> None:
        self._folder = folder
        self._record = record
        with writing(folder.path):
            if record.images != "none":
                folder.image(0).parent.mkdir(exist_ok=goes_on)
            if record.plans:
                folder.plan(0).parent.mkdir(exist_ok=goes_on)
        logs = (folder.steps, folder.plans, folder.frames, folder.trajectory)
        self._steps, self._plans, self._frames, self._trajectory = (LineWriter(path, goes_on=goes_on) for path in logs)
        self._num_frames = 0
        self._poses: list[Pose2] = []
        self._last_target_xy_m: Float[np.ndarray, "2"] | None = None

    def cut(self, sizes: Mapping[str, int], step: int) -> None:
        """Remove what a run that was killed wrote after a step, given the lengths that its logs had then by name
        [bytes]: later lines, images of later observations, and later decisions.
        """
        with writing(self._folder.path):
            _remove_after(self._folder, step)
        for file in self.files:
            file.cut(sizes.get(file.path.name, 0))

    @property
    def num_frames(self) -> int:
        """Number of observations so far."""
        return self._num_frames

    @property
    def poses(self) -> list[Pose2]:
        """Poses of the base so far, without those of frames whose pose was not known."""
        return self._poses

    @property
    def last_target_xy_m(self) -> Float[np.ndarray, "2"] | None:
        """The latest target, world [m]."""
        return self._last_target_xy_m

    def observation(
        self,
        observation: Observation,
        true: TrueView | None = None,
        depth_mm: UInt16[np.ndarray, "rows cols"] | None = None,
        estimate: PoseEstimate | None = None,
        fit: Mapping[str, Any] | None = None,
        *,
        closes_loop: bool = False,
    ) -> None:
        """Record an observation; the first one comes before any action. ``true`` is what it was truly made of, where
        that differs; ``depth_mm`` the reduced depth, of the truth where the sensor gave a value [mm], None = it is
        reduced here; ``estimate`` what localisation says of the pose; ``fit`` how well the frame fits the map of those
        before it, by name; ``closes_loop``: whether it moved earlier keyframes.
        """
        if not self._num_frames:
            _write_camera(self._folder.camera, observation)
        if depth_mm is None:
            depth_mm = reduce_depth(observation.depth_m if true is None else true.depth_m)
        path = self._folder.depth(observation.step)
        with writing(path), removed_on_error(path):
            # The lowest compression: a fifth larger than the highest, at a fraction of its time.
            Image.fromarray(depth_mm).save(path, compress_level=1)
        self._write_image(observation)
        line = {
            "step": observation.step,
            "time_s": observation.time_s,
            **_where(observation.pose, observation.T_world_camera),
        }
        # Nothing was seen before the clock of the simulation began.
        if age_s := min(observation.image_age_s, observation.time_s):
            line["image_age_s"] = age_s
        if true is not None:
            line["true"] = _where(true.pose, true.T_world_camera)
        if true is not None and true.people is not None:
            line["people"] = true.people.states
            moved = {"chair": true.people.chair, "vacuums": true.people.vacuums, "doors": true.people.doors}
            line |= {key: states for key, states in moved.items() if states is not None and len(states)}
        if estimate is not None:
            line["localisation"] = {
                "state": estimate.state,
                "usable": estimate.usable,
                "relocalised": estimate.relocalised,
                "closes_loop": closes_loop,
                "deviation_m": estimate.position_deviation_m,
                "deviation_rad": estimate.rotation_deviation_rad,
                "known": estimate.quality.known,
                "inliers": estimate.quality.inliers,
                "bound": estimate.quality.bound,
                "covariance_xy_m2": [estimate.covariance[0, 0], estimate.covariance[0, 1], estimate.covariance[1, 1]],
            }
        if fit is not None:
            line["fit"] = fit
        self._frames.json(line)
        self._num_frames += 1
        if estimate is None or estimate.state is TrackingState.TRACKING:
            self._trajectory.line(base_line(observation.time_s, observation.pose))
            self._poses.append(observation.pose)

    def step(self, step: int, result: ActionResult, pose: Pose2, update: MapUpdate, stage_ms: dict[str, float]) -> None:
        """Record an executed action; ``pose`` is the pose after it."""
        self._steps.json(
            {
                "step": step,
                "action": result.action.name,
                **vars(pose),
                "collided": result.collided,
                "moved_m": result.moved_m,
                **vars(result.wheel_speeds),
                "loss": update.loss,
                "iterations": update.num_iterations,
                "keyframes": update.num_keyframes,
                "ms": stage_ms,
            }
        )

    def plan(self, step: int, plan: Plan) -> None:
        """Record a decision."""
        if plan.target_xy_m is not None:
            self._last_target_xy_m = plan.target_xy_m
        path = plan.path_xy_m
        self._plans.json(
            {
                "step": step,
                "reason": plan.reason,
                "target_xy_m": plan.target_xy_m,
                "path_length_m": sum(math.dist(a, b) for a, b in pairwise(path)),
                "headings_rad": plan.headings_rad,
                "actions": [action.name for action in plan.actions],
                "stop": plan.stop,
                "unexplored": plan.unexplored,
                "vertices": None if plan.graph is None else len(plan.graph.vertex_xy_m),
                "regions": len(plan.regions),
                "candidates": plan.candidates,
                "closed": plan.closed,
                "ms": plan.stage_ms,
            }
        )
        if self._record.plans:
            write_plan(self._folder.plan(step), plan)

    @property
    def files(self) -> tuple[LineWriter, ...]:
        """All logs."""
        return self._steps, self._plans, self._frames, self._trajectory

    def close(self) -> None:
        """Close all files; a second time does nothing."""
        for file in self.files:
            file.close()

    def _write_image(self, observation: Observation) -> None:
        if self._record.images == "none":
            return
        path = self._folder.image(observation.step)
        with writing(path), removed_on_error(path):
            if self._record.images == "full":
                Image.fromarray(observation.rgb).save(path, quality=FULL_QUALITY, subsampling=0)
            else:
                _small(observation.rgb).save(path, quality=SMALL_QUALITY)


def _remove_after(folder: RunFolder, step: int) -> None:
    """Remove what a run that was killed wrote after a step: images of later observations, and later decisions."""
    for place, first in ((folder.depth, step + 1), (folder.image, step + 1), (folder.plan, step)):
        if place(0).parent.is_dir():
            for path in place(0).parent.iterdir():
                number, least = path.stem, place(first).stem
                # Names of a million steps and more are longer.
                if (len(number), number) >= (len(least), least) or path.name.startswith("."):
                    path.unlink()


def _small(rgb: UInt8[np.ndarray, "h w 3"]) -> Image.Image:
    image = Image.fromarray(rgb)
    image.thumbnail((EVALUATION_SIDE_PX, EVALUATION_SIDE_PX), Image.Resampling.BOX)
    return image


def _where(pose: Pose2, T_world_camera: Float[np.ndarray, "4 4"]) -> dict[str, Any]:
    """Poses of base and camera, in the keys of ``frames.jsonl``."""
    return {**vars(pose), "T_world_camera": T_world_camera}


def _write_camera(path: Path, observation: Observation) -> None:
    rows, cols = reduce_depth(observation.depth_m).shape
    pixels = "row i is row floor(i * height / rows) of the original image, columns likewise"
    depth = {"rows": rows, "cols": cols, "unit": "millimetre of planar z, 0 where nothing", "pixels": pixels}
    write_json(path, {"intrinsics": observation.intrinsics, "depth": depth})
