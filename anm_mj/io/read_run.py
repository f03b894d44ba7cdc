"""Reads a run folder; that of a killed run is read up to its last complete line."""

import functools
import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt16
from msgspec.structs import asdict

from anm_mj.errors import RunFolderError
from anm_mj.ground_truth.reduced_depth import EVALUATION_SIDE_PX
from anm_mj.io.camera_checks import check_camera, check_time, no_poses
from anm_mj.io.image import read_image
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.run_records import FrameRecord
from anm_mj.io.run_shapes import CameraShape, ConfigShape, FrameShape, ManifestShape, PlanShape, PoseShape, StepShape
from anm_mj.io.write import reading
from anm_mj.types import Action, Footprint, Intrinsics, Pose2
from anm_mj.utils import read_file
from anm_mj.utils.picture import open_picture
from anm_mj.utils.read_file import convert, is_below, read_bytes

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Run:
    """The content of a run folder."""

    folder: RunFolder
    intrinsics: Intrinsics
    """Of the original images."""
    depth_shape: tuple[int, int]
    """Rows and columns of the reduced depth images."""
    frames: tuple[FrameRecord, ...]
    """All of them; :attr:`posed_frames` are those whose pose was known."""
    steps: tuple[StepShape, ...]
    plans: tuple[dict[str, Any], ...]
    """Lines of ``plans.jsonl``, uninterpreted but for the characters of ``reason``."""
    manifest: dict[str, Any]
    """Empty if the file is missing."""
    config: dict[str, Any]
    """Empty if the file is missing."""

    @property
    def footprint(self) -> Footprint | None:
        """The space that the robot swept; None for a recorded sequence, and where an older manifest does not say."""
        found = self.manifest.get("footprint")
        return None if found is None else Footprint(**found)

    @property
    def posed_frames(self) -> tuple[FrameRecord, ...]:
        """Those whose pose the robot knew: that of a lost one may even be of another world."""
        return tuple(frame for frame in self.frames if not frame.is_lost)

    @property
    def known_poses(self) -> list[Pose2 | None]:
        """Where the robot believed that it was in each frame; None where it was lost."""
        return [None if frame.is_lost else frame.pose for frame in self.frames]

    def depth_mm(self, frame: FrameRecord) -> UInt16[np.ndarray, "rows cols"]:
        """Reduced depth of a frame [mm]. Raises RunFolderError if the image is missing, damaged, or of another size
        than ``camera.json`` says.
        """
        path = self.folder.depth(frame.step)
        depth_mm = read_image(path).astype(np.uint16)
        if depth_mm.shape != self.depth_shape:
            raise RunFolderError(
                f"{path} has {depth_mm.shape} rows and columns, but camera.json says {self.depth_shape}; copy the run "
                "again."
            )
        return depth_mm

    def picture_bytes(self, path: Path) -> bytes:
        """Content of an image file of the run, colour or depth, for a copy. Raises RunFolderError if it is missing, no
        picture, or lies outside of the run's folder.
        """
        if not is_below(path, self.folder.path):
            raise RunFolderError(f"{path} leads out of the run's folder; copy the run again.")
        with reading(path, remedy="copy the run again"):
            with open_picture(path) as picture:
                # A damaged one is found here, not by whoever reads the copy.
                picture.load()
            return read_bytes(path)


def read_run(path: Path) -> Run:
    """Read a run folder. Raises RunFolderError if the folder contains no run, or a file in it is damaged."""
    folder = RunFolder.open(path)
    try:
        camera = convert(read_json(folder.camera), CameraShape)
        frames = tuple(_frame(convert(line, FrameShape)) for line in read_jsonl(folder.frames))
        _check_frames(frames)
        steps = tuple(_step(convert(line, StepShape)) for line in read_jsonl(folder.steps))
        # A recorded sequence has no steps, and leaves out images that nobody can read.
        _check_order("frames.jsonl", [frame.step for frame in frames], gaps=not steps)
        _check_order("steps.jsonl", [step.step for step in steps])
        for words in contradictions(frames, steps):
            _warn(f"{path}: {words}")
        return Run(
            folder=folder,
            intrinsics=_intrinsics(camera),
            depth_shape=(camera.depth.rows, camera.depth.cols),
            frames=frames,
            steps=steps,
            plans=tuple(_plan(line) for line in read_jsonl(folder.plans)) if folder.plans.is_file() else (),
            manifest=_checked(read_json(folder.manifest), ManifestShape) if folder.manifest.is_file() else {},
            config=_checked(read_json(folder.config), ConfigShape) if folder.config.is_file() else {},
        )
    except (KeyError, TypeError, ValueError) as err:
        raise RunFolderError(f"{path} is damaged, or of another version of this program ({err}).") from err


def read_json(path: Path) -> dict[str, Any]:
    """The object in a JSON file. Raises RunFolderError if it cannot be read, or contains something else."""
    with reading(path, remedy="copy the run again"):
        value = read_file.read_json(path)
    if not isinstance(value, dict):
        raise RunFolderError(f"{path} holds {type(value).__name__} where an object should stand; copy the run again.")
    return value


def run_title(folder: RunFolder) -> str:
    """Scene, policy and seed of a run, or its folder's name. Raises RunFolderError for an unreadable manifest."""
    facts = read_json(folder.manifest) if folder.manifest.is_file() else {}
    if "scene" not in facts:
        return folder.path.name
    policy = f", {facts['policy']}" if facts.get("policy") else ""
    seed = f", seed {facts['seed']}" if facts.get("seed") is not None else ""
    title = f"{Path(str(facts['scene'])).name}{policy}{seed}"
    # Fonts have no glyph for what commands a terminal, and warn of it.
    return _printable(title)


def titled(folder: RunFolder, metrics: Mapping[str, Any]) -> str:
    """Two lines: what the run is, and its headline metric and length; what is missing or None is left out. ``metrics``
    have the keys of ``metrics.json``. Raises RunFolderError if the manifest cannot be read.
    """
    parts = []
    for key, words in (("observable_ratio", "of the observable surface"), ("completion_ratio", "of the surface")):
        if metrics.get(key) is not None and not parts:
            parts.append(f"{metrics[key]:.1f} % {words}")
    for key, form in (("steps", "{} steps"), ("frames", "{} recorded frames"), ("path_m", "{:.1f} m")):
        if metrics.get(key) is not None:
            parts.append(form.format(metrics[key]))
    return "\n".join([run_title(folder), ", ".join(parts)] if parts else [run_title(folder)])


def _checked(value: Any, shape: type) -> Any:
    """A value as it is, if it has a shape; raises ValueError otherwise."""
    convert(value, shape)
    return value


def _intrinsics(camera: CameraShape) -> Intrinsics:
    """Raises ValueError for what is no camera, or where the depth images are not those of its images."""
    intrinsics = Intrinsics(**asdict(camera.intrinsics))
    try:
        check_camera(intrinsics)
    except ValueError as err:
        raise ValueError(f"camera.json has {err}") from err
    reduced = tuple(min(size, EVALUATION_SIDE_PX) for size in (intrinsics.height, intrinsics.width))
    if (camera.depth.rows, camera.depth.cols) != reduced:
        raise ValueError(
            f"camera.json has depth of {camera.depth.rows} rows and {camera.depth.cols} columns for images of "
            f"{intrinsics.width} x {intrinsics.height} pixels"
        )
    return intrinsics


def _check_frames(frames: tuple[FrameRecord, ...]) -> None:
    """Raises ValueError for a frame whose camera stands nowhere, or whose time no clock shows."""
    for frame in frames:
        try:
            check_time(frame.time_s)
        except ValueError as err:
            raise ValueError(f"step {frame.step} in frames.jsonl has {err}") from err
    for matrices in ([frame.T_world_camera for frame in frames], [frame.T_true_camera for frame in frames]):
        wrong = no_poses(np.array(matrices).reshape(-1, 4, 4))
        if wrong.any():
            step = frames[int(np.argmax(wrong))].step
            raise ValueError(f"step {step} in frames.jsonl has a T_world_camera that is no pose of a camera")


def _check_order(name: str, steps: list[int], *, gaps: bool = False) -> None:
    """Raises ValueError for lines that are not in the order of their steps, each of which has one unless there may be
    ``gaps``.
    """
    for before, after in pairwise(steps):
        if after <= before or (after > before + 1 and not gaps):
            raise ValueError(f"step {after} in {name} stands after step {before}")


@functools.cache
def _warn(text: str) -> None:
    """Say something once, however often a run is read."""
    _logger.warning("%s", text)


def _plan(line: dict[str, Any]) -> dict[str, Any]:
    """A line of ``plans.jsonl``; no character of its reason breaks the line, or turns what follows around."""
    convert(line, PlanShape)
    if "reason" not in line:
        return line
    return {**line, "reason": _printable(line["reason"])}


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)


def _frame(line: FrameShape) -> FrameRecord:
    # The file has true poses only where they differ from the believed ones.
    true = line.true or line
    believed_camera, true_camera = (np.array(where.T_world_camera, dtype=np.float64) for where in (line, true))
    found = line.localisation
    is_lost, is_mapped = found is not None and found.state == "LOST", found is None or found.usable
    poses = _pose(line), believed_camera, _pose(true), true_camera
    moving = {"people": tuple(line.people), "vacuums": tuple(line.vacuums), "doors": tuple(line.doors)}
    covariance = None if found is None else found.covariance_xy_m2
    judged = is_lost, is_mapped, found is not None and found.closes_loop
    seen = {"chair": line.chair, "covariance_xy_m2": covariance, "image_age_s": line.image_age_s}
    return FrameRecord(line.step, line.time_s, *poses, *judged, **moving, **seen)


def _step(line: StepShape) -> StepShape:
    """The same; raises ValueError for an action that no robot has."""
    if line.action not in Action.__members__:
        raise ValueError(f"there is no action {line.action[:40]!r}")
    return line


def _pose(line: PoseShape) -> Pose2:
    return Pose2(line.x_m, line.y_m, line.yaw_rad)


_LONGEST_STEP_M = 10.0
"""No action moves a robot so far; a forward step has 6.5 cm [m]."""
_FARTHEST_CAMERA_M = 10.0
"""No camera stands so far beside its robot [m]."""


def contradictions(frames: Sequence[FrameRecord], steps: Sequence[StepShape]) -> Iterator[str]:
    """One sentence for each kind of contradiction; none for a run that was killed, whose logs end a line apart."""
    if not frames:
        return
    if steps and abs(frames[-1].step - steps[-1].step) > 1:
        yield (
            f"frames.jsonl ends at step {frames[-1].step} and steps.jsonl at step {steps[-1].step}; metrics count each "
            "as far as it goes. Copy the run again."
        )
    numbers = [frame.step for frame in frames]
    believed = np.array([frame.T_world_camera[:3, 3] for frame in frames])
    true = np.array([frame.T_true_camera[:3, 3] for frame in frames])
    base = np.array([(frame.pose.x_m, frame.pose.y_m) for frame in frames])
    true_base = np.array([(frame.true_pose.x_m, frame.true_pose.y_m) for frame in frames])
    for camera, robot in ((believed, base), (true, true_base)):
        beside_m = np.linalg.norm(camera[:, :2] - robot, axis=1)
        if beside_m.max() > _FARTHEST_CAMERA_M:
            at = int(beside_m.argmax())
            yield f"in frames.jsonl, the camera of step {numbers[at]} is {beside_m[at]:.4g} m beside its robot."
            return
        # A recorded sequence has no steps, and may have been cut.
        moved_m = np.linalg.norm(np.diff(camera, axis=0), axis=1) if steps else np.zeros(0)
        if camera is believed and steps:
            # A robot that was lost may be found anywhere.
            moved_m[[frame.is_lost for frame in frames[:-1]]] = 0.0
        if moved_m.max(initial=0.0) > _LONGEST_STEP_M:
            at = int(moved_m.argmax())
            yield f"in frames.jsonl, step {numbers[at + 1]} is {moved_m[at]:.4g} m from step {numbers[at]}."
            return
