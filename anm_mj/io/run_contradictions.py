"""What the logs of a run say that cannot all be true."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from anm_mj.io.run_records import FrameRecord, StepRecord

_LONGEST_STEP_M = 10.0
"""No action moves a robot so far; a forward step has 6.5 cm [m]."""
_FARTHEST_CAMERA_M = 10.0
"""No camera stands so far beside its robot [m]."""


def contradictions(frames: Sequence[FrameRecord], steps: Sequence[StepRecord]) -> Iterator[str]:
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
        if moved_m.max(initial=0.0) > _LONGEST_STEP_M:
            at = int(moved_m.argmax())
            yield f"in frames.jsonl, step {numbers[at + 1]} is {moved_m[at]:.4g} m from step {numbers[at]}."
            return
