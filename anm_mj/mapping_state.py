"""Where the mapping of a recorded sequence stands, for a checkpoint, and how it is read back."""

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from anm_mj.checkpoint.checkpoint_file import StoredState
from anm_mj.checkpoint.going_on import LoggedFacts, first_difference, logged_facts
from anm_mj.checkpoint.store import CheckpointStore
from anm_mj.config import RunConfig, leaves
from anm_mj.errors import CheckpointError
from anm_mj.io.run_folder import RunFolder, refuse_links
from anm_mj.io.run_records import FrameRecord
from anm_mj.io.sequence import Sequence
from anm_mj.io.to_json import to_json
from anm_mj.sequence_check.frame_fit import FrameFit
from anm_mj.types import Observation
from anm_mj.utils.read_file import convert
from anm_mj.utils.stopwatch import Stopwatch

_FREE = ("scene", "device", "checkpoint")
"""Settings that may differ: the sequence is compared by its content, and the others do not change a frame."""


class MappingState:
    """What was mapped so far."""

    def __init__(self) -> None:
        self.records: list[FrameRecord] = []
        self.fits: list[FrameFit] = []
        self.watch = Stopwatch()
        self.last: Observation | None = None
        """The last frame."""

    @property
    def next_frame(self) -> int:
        """Number of the frame to go on with."""
        return 0 if self.last is None else self.last.step + 1


class _Facts(LoggedFacts):
    """What a mapping says of itself in a checkpoint."""

    config: dict[str, Any]
    options: dict[str, Any]
    """Others than the configuration's."""
    sequence: str
    """Hash of the frames."""


def stored_mapping(folder: RunFolder, sequence: Sequence, config: RunConfig, options: Mapping[str, Any]) -> StoredState:
    """The newest checkpoint of a mapping that did not end. Raises RunFolderError if there is a link in the folder, and
    CheckpointError if there is none, or it is one of another sequence or of other settings.
    """
    refuse_links(folder.path.resolve())
    stored = CheckpointStore(folder.checkpoints).newest(lambda state: logged_facts(state, _Facts, folder.path, "frame"))
    facts = convert(stored.facts, _Facts)
    if facts.sequence != digest(sequence):
        raise CheckpointError(
            f"The sequence is not the one that {folder.path} began with, or is read in another way (camera, poses, "
            "colour, floor, every Nth frame); give the same, or start a new run."
        )
    before = {**dict(leaves(facts.config)), **facts.options}
    now = {**dict(leaves(to_json(config))), **options}
    name = first_difference(before, now, _FREE)
    if name is not None:
        raise CheckpointError(
            f"{name} is {now[name]!r:.60}, and {folder.path} began with {before[name]!r:.60}; give the same, or start "
            "a new run."
        )
    return stored


def digest(sequence: Sequence) -> str:
    """Hash of what decides how frames are seen, but for the pixels themselves."""
    frames = sequence.frames
    numbers = np.array([[frame.time_s, *frame.T_world_camera.ravel()] for frame in frames])
    facts = (sequence.intrinsics, sequence.depth_unit_m, sequence.depth_scale, sequence.ray_depth, sequence.mirrored)
    said = repr((len(frames), facts, sequence.distortion, sequence.has_poses, sequence.colour_offset_s))
    return hashlib.sha256(said.encode() + numbers.astype(np.float64).tobytes()).hexdigest()
