"""Tracks a recorded sequence offline and compares the poses found with those recorded.

python scripts/record_sequence.py home /tmp/walk --steps 500
python scripts/track_sequence.py /tmp/walk --odometry-alpha 0.01
python scripts/track_sequence.py /tmp/walk --free
"""

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from numpy.typing import NDArray

from anm_mj.evaluation.trajectory_error import alignment
from anm_mj.frames import pose_matrix, transform_points
from anm_mj.io.sequence import base_pose
from anm_mj.io.sequence_layouts import open_sequence
from anm_mj.localisation.field_localiser import FieldLocaliser
from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.mapping.mapping_config import MAPPING_PRESETS
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.sim.sensors.noisy_odometry import NoisyOdometry
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.types import Observation


def main(
    path: Annotated[Path, tyro.conf.Positional],
    frames: int = 100_000,
    free: bool = False,
    odometry_alpha: float = 0.01,
    preset: str = "default",
    seed: int = 0,
) -> None:
    """Track and compare.

    Args:
        path: the sequence, with poses.
        frames: frames at most.
        free: without any pose but the first, in six degrees of freedom; else the recorded poses with the errors of
            wheel odometry are the prior, and the camera moves in the plane.
        odometry_alpha: each of the four variances of that odometry.
        preset: of the map.
        seed: of map, odometry and choice of points.
    """
    sequence, layout = open_sequence(path)
    neural_map = NeuralMap(MAPPING_PRESETS[preset](), seed=seed, device="cpu")
    localiser = FieldLocaliser(
        neural_map,
        LocalisationConfig(),
        seed=seed,
        planar=not free,
        odometry=not free,
        base_pose=base_pose if free else None,
    )
    odometry = NoisyOdometry(
        SensorConfig(odometry_alpha=(odometry_alpha, odometry_alpha, odometry_alpha, odometry_alpha)), seed
    )
    found, true, track_s, unusable = [], [], 0.0, 0
    for frame in sequence.observations():
        if len(found) >= frames:
            break
        begin = time.process_time()
        estimate = localiser.localise(_with_prior(frame, odometry, free=free, first=not found))
        track_s += time.process_time() - begin
        if estimate.usable:
            localiser.integrate(estimate)
        unusable += not estimate.usable
        found.append(estimate.observation.T_world_camera)
        true.append(frame.T_world_camera)
    found_m, true_m = np.stack(found)[:, :3, 3], np.stack(true)[:, :3, 3]
    apart = np.linalg.norm(found_m - true_m, axis=1)
    aligned = np.linalg.norm(transform_points(alignment(found_m, true_m), found_m) - true_m, axis=1)
    print(
        f"{len(found)} frames ({layout}): RMSE {_rmse_cm(apart):.2f} cm, aligned {_rmse_cm(aligned):.2f} cm, "
        f"at the end {100 * apart[-1]:.1f} cm; {unusable} not mapped; {1e3 * track_s / len(found):.1f} ms of CPU each"
    )


def _with_prior(frame: Observation, odometry: NoisyOdometry, *, free: bool, first: bool) -> Observation:
    """The frame with the pose that the localiser may know."""
    if free:
        # The first frame defines the world; later poses are not looked at.
        return frame if first else replace(frame, T_world_camera=np.eye(4))
    pose = odometry.read(frame.pose)
    T_base_camera = np.linalg.inv(pose_matrix(frame.pose)) @ frame.T_world_camera
    return replace(frame, pose=pose, T_world_camera=pose_matrix(pose) @ T_base_camera)


def _rmse_cm(distances_m: NDArray[np.float64]) -> float:
    return 100.0 * float(np.sqrt(np.mean(distances_m**2)))


if __name__ == "__main__":
    tyro.cli(main)
