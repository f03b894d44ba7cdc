"""The map follows keyframes whose poses are corrected."""

from dataclasses import replace

import numpy as np

from anm_mj.mapping.mapping_config import MappingConfig
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.mapping.occupancy_kernels import DepthFrame
from anm_mj.types import OCCUPIED, UNKNOWN, Observation, TrainingEffort
from tests.mapping.ray_room import Room

SHIFT_M = 0.3
"""Eight voxels or so to the side."""
EFFORT = TrainingEffort(8, 100, True)


def mapped(config: MappingConfig, frames: list[Observation]) -> NeuralMap:
    """A map of frames, all of which are keyframes."""
    neural_map = NeuralMap(config, seed=0, device="cpu")
    for frame in frames:
        neural_map.integrate(frame, EFFORT)
    return neural_map


def beside(frame: Observation) -> Observation:
    T = frame.T_world_camera.copy()
    T[1, 3] += SHIFT_M
    return replace(frame, T_world_camera=T)


def wall_points(room: Room) -> np.ndarray:
    """Points on the wall at y = 3, as the room has it."""
    x, z = np.meshgrid(np.linspace(0.8, 2.2, 8), np.linspace(0.8, 1.6, 5))
    return np.stack((x.ravel(), np.full(x.size, 3.0), z.ravel()), axis=1)


def test_occupancy_and_field_go_where_the_keyframes_go(tiny_config: MappingConfig, room: Room) -> None:
    frames = [room.observe(1.5, 1.5, 1.2 + 0.2 * k, size=64, step=k) for k in range(5)]
    neural_map = mapped(tiny_config, [beside(frame) for frame in frames])
    points = wall_points(room)
    by_depth = neural_map.occupancy.by_depth
    assert not (by_depth.state_at(points) == OCCUPIED).any()
    wrong = np.abs(neural_map.sdf(points)).mean()
    version, noise = by_depth.grid.version, by_depth.noise.value
    neural_map.move_keyframes(np.arange(5, 0, -1), np.stack([frame.T_world_camera for frame in frames]))
    neural_map.rebuild((DepthFrame(f.depth_m, f.intrinsics, f.T_world_camera) for f in frames), 60)
    assert (by_depth.state_at(points) == OCCUPIED).mean() > 0.9
    assert not (by_depth.state_at(points + np.array([0.0, SHIFT_M, 0.0])) == OCCUPIED).any()
    assert np.abs(neural_map.sdf(points)).mean() < 0.5 * wrong
    assert by_depth.grid.version > version
    assert (by_depth.grid.column_version == by_depth.grid.version).all()
    assert by_depth.noise.value == noise


def test_what_no_keyframe_shows_is_unknown_again(tiny_config: MappingConfig, room: Room) -> None:
    frames = [room.observe(1.5, 1.5, 1.2 + 0.2 * k, size=64, step=k) for k in range(3)]
    neural_map, fresh = mapped(tiny_config, frames), mapped(tiny_config, frames[:1])
    neural_map.rebuild([DepthFrame(frames[0].depth_m, frames[0].intrinsics, frames[0].T_world_camera)], 1)
    grid, expected = neural_map.occupancy.by_depth.grid, fresh.occupancy.by_depth.grid
    assert (grid.state != UNKNOWN).sum() == (expected.state != UNKNOWN).sum() > 1000
    assert (grid.state == OCCUPIED).sum() == (expected.state == OCCUPIED).sum()
    assert np.isfinite(grid.seen_range_m).sum() == np.isfinite(expected.seen_range_m).sum()


def test_what_no_keyframe_shows_moves_with_the_nearest(tiny_config: MappingConfig, room: Room) -> None:
    frames = [room.observe(1.5, 1.5, 1.2 + 0.2 * k, size=64, step=k) for k in range(5)]
    neural_map, right = mapped(tiny_config, [beside(frame) for frame in frames]), mapped(tiny_config, frames)
    before, after = (np.stack([f.T_world_camera for f in some]) for some in ((beside(f) for f in frames), frames))
    first = frames[0]
    neural_map.rebuild([DepthFrame(first.depth_m, first.intrinsics, first.T_world_camera)], 1, (before, after))
    by_depth, expected = (each.occupancy.by_depth for each in (neural_map, right))
    points = np.argwhere(expected.voxels.state != UNKNOWN)[:, ::-1] + expected.voxels.corner
    states = [each.state_at(points * tiny_config.occupancy.voxel_m) for each in (by_depth, expected)]
    assert (states[0] == states[1]).mean() > 0.99
    # What one frame shows is a part of it.
    alone = mapped(tiny_config, frames[:1]).occupancy.by_depth.state_at(points * tiny_config.occupancy.voxel_m)
    assert (alone == states[1]).mean() < 0.8
    # Blocks through which was looked hold no surface; the nearest column of some lies in the next block.
    np.testing.assert_allclose(by_depth.surface_volume_m3(), expected.surface_volume_m3(), rtol=0.1)


def test_the_last_frame_goes_with_its_keyframe(tiny_config: MappingConfig, room: Room) -> None:
    frames = [room.observe(1.5, 1.5, 1.2 + 0.2 * k, size=64, step=k) for k in range(3)]
    moved, right = mapped(tiny_config, [*frames[:2], beside(frames[2])]), mapped(tiny_config, frames)
    moved.move_keyframes(np.array([1]), frames[2].T_world_camera[None])

    cameras, expected = (each.field.keyframes.get_state()[1] for each in (moved, right))
    np.testing.assert_array_equal(cameras, expected)
    assert moved.field._last is not None
    np.testing.assert_array_equal(moved.field._last.T_world_camera, frames[2].T_world_camera)
