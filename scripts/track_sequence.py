"""Tracks a recorded sequence offline from wheel odometry made of its poses, and compares what is found with those.

python scripts/record_sequence.py home /tmp/walk --steps 500
python scripts/track_sequence.py /tmp/walk --odometry-alpha 0.01

``anm-mj map --track --reference`` does the same for a camera in the hand, without odometry.
"""

import itertools
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from anm_mj.cli.command_line import run_script
from anm_mj.evaluation.trajectory_error import trajectory_error
from anm_mj.frames import pose_matrix
from anm_mj.io.run_records import FrameRecord
from anm_mj.io.sequence_layouts import open_sequence
from anm_mj.localisation.field_localiser import FieldLocaliser
from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.localisation.localiser import TrackingState
from anm_mj.mapping.mapping_config import MAPPING_PRESETS
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.sim.sensors.noisy_odometry import NoisyOdometry
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.types import Observation


def main(
    path: Annotated[Path, tyro.conf.Positional],
    frames: int | None = None,
    odometry_alpha: float = 0.01,
    preset: str = "default",
    seed: int = 0,
) -> None:
    """Track and compare.

    Args:
        path: the sequence, with poses.
        frames: frames at most.
        odometry_alpha: each of the four variances of the odometry.
        preset: of the map.
        seed: of map, odometry and choice of points.
    """
    sequence, layout = open_sequence(path)
    neural_map = NeuralMap(MAPPING_PRESETS[preset](), seed=seed, device="cpu")
    localiser = FieldLocaliser(neural_map, LocalisationConfig(), seed=seed, planar=True, odometry=True)
    alpha = (odometry_alpha, odometry_alpha, odometry_alpha, odometry_alpha)
    odometry = NoisyOdometry(SensorConfig(odometry_alpha=alpha), seed)
    records, track_s = [], 0.0
    for frame in itertools.islice(sequence.observations(), frames):
        begin = time.process_time()
        estimate = localiser.localise(_with_odometry(frame, odometry))
        track_s += time.process_time() - begin
        if estimate.usable:
            localiser.integrate(estimate)
        found = estimate.observation
        poses = found.pose, found.T_world_camera, frame.pose, frame.T_world_camera
        is_lost = estimate.state is TrackingState.LOST
        records.append(FrameRecord(frame.step, frame.time_s, *poses, is_lost=is_lost, is_mapped=estimate.usable))
    error = trajectory_error(records)
    print(
        f"{len(records)} frames ({layout}): RMSE {error.position_rmse_cm:.2f} cm, aligned {error.ate_rmse_cm:.2f} cm, "
        f"at the end {error.final_position_error_cm:.1f} cm and {error.final_heading_error_deg:.2f} deg; "
        f"{error.unmapped_percent:.1f} % not mapped; {1e3 * track_s / len(records):.1f} ms of CPU each"
    )


def _with_odometry(frame: Observation, odometry: NoisyOdometry) -> Observation:
    """The frame with the pose that wheels would have measured."""
    pose = odometry.read(frame.pose)
    T_base_camera = np.linalg.inv(pose_matrix(frame.pose)) @ frame.T_world_camera
    return replace(frame, pose=pose, T_world_camera=pose_matrix(pose) @ T_base_camera)


if __name__ == "__main__":
    run_script(main)
