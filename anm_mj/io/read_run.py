"""What a run wrote, read back; a run that was killed reads as far as it came."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt16
from PIL import Image, UnidentifiedImageError

from anm_mj.errors import RunFolderError
from anm_mj.io.jsonl import read_json_lines
from anm_mj.io.run_folder import RunFolder
from anm_mj.types import Action, Intrinsics, Pose2, WheelSpeeds


@dataclass(frozen=True)
class FrameRecord:
    """One observation of a run."""

    step: int
    time_s: float
    pose: Pose2
    """Where the robot stood, as far as it knew."""
    T_world_camera: Float[np.ndarray, "4 4"]
    """Where its camera was, as far as it knew."""
    true_pose: Pose2
    """Where it truly stood."""
    T_true_camera: Float[np.ndarray, "4 4"]
    """Where its camera truly was."""


@dataclass(frozen=True)
class StepRecord:
    """One executed action of a run."""

    step: int
    action: Action
    pose: Pose2
    """Where the robot stood after it."""
    collided: bool
    moved_m: float
    wheel_speeds: WheelSpeeds
    stage_ms: dict[str, float]


@dataclass(frozen=True)
class Run:
    """What a run left."""

    folder: RunFolder
    intrinsics: Intrinsics
    """Of the original images."""
    frames: tuple[FrameRecord, ...]
    steps: tuple[StepRecord, ...]
    plans: tuple[dict[str, Any], ...]
    """Lines of ``plans.jsonl`` as they stand there."""
    manifest: dict[str, Any]
    """Empty where none was written."""
    config: dict[str, Any]
    """Empty where none was written."""

    def depth_mm(self, frame: FrameRecord) -> UInt16[np.ndarray, "rows cols"]:
        """Reduced depth of a frame [mm].

        Raises:
            RunFolderError: The picture is missing or cut short.
        """
        return read_depth(self.folder.depth(frame.step))


def read_run(path: Path) -> Run:
    """Read a run folder.

    Raises:
        RunFolderError: It is not a run folder, or a file in it is damaged.
    """
    folder = RunFolder.open(path)
    try:
        return Run(
            folder=folder,
            intrinsics=Intrinsics(**read_json(folder.camera)["intrinsics"]),
            frames=tuple(_frame(line) for line in read_json_lines(folder.frames)),
            steps=tuple(_step(line) for line in read_json_lines(folder.steps)),
            plans=tuple(read_json_lines(folder.plans)) if folder.plans.is_file() else (),
            manifest=read_json(folder.manifest) if folder.manifest.is_file() else {},
            config=read_json(folder.config) if folder.config.is_file() else {},
        )
    except (KeyError, TypeError, ValueError) as err:
        raise RunFolderError(f"{path} was written by another version of this program ({err!r}).") from err


def read_json(path: Path) -> dict[str, Any]:
    """A JSON file that holds an object.

    Raises:
        RunFolderError: It cannot be read, or holds something else.
    """
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as err:
        raise RunFolderError(f"{path} cannot be read ({err}); copy the run again.") from err
    if not isinstance(value, dict):
        raise RunFolderError(f"{path} holds {type(value).__name__} where an object should stand; copy the run again.")
    return value


def read_depth(path: Path) -> UInt16[np.ndarray, "rows cols"]:
    """A 16-bit depth picture [mm].

    Raises:
        RunFolderError: The picture is missing or cut short.
    """
    try:
        with Image.open(path) as picture:
            return np.asarray(picture).astype(np.uint16)
    except (OSError, SyntaxError, UnidentifiedImageError) as err:
        raise RunFolderError(f"{path} cannot be read ({err}); copy the run again.") from err


def _frame(line: dict[str, Any]) -> FrameRecord:
    # The truth stands there only where it differs from what the robot was told.
    true = line.get("true", line)
    believed_camera, true_camera = (np.array(where["T_world_camera"], dtype=np.float64) for where in (line, true))
    return FrameRecord(line["step"], line["time_s"], _pose(line), believed_camera, _pose(true), true_camera)


def _step(line: dict[str, Any]) -> StepRecord:
    return StepRecord(
        step=line["step"],
        action=Action[line["action"]],
        pose=_pose(line),
        collided=line["collided"],
        moved_m=line["moved_m"],
        wheel_speeds=WheelSpeeds(line["left_radps"], line["right_radps"]),
        stage_ms=line["ms"],
    )


def _pose(line: dict[str, Any]) -> Pose2:
    return Pose2(line["x_m"], line["y_m"], line["yaw_rad"])
