"""A short run through a box room, made without simulator and without learning."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from anm_mj.events import Ended
from anm_mj.frames import move_pose, pixel_directions
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.io.run_folder import RunFolder
from anm_mj.recording.recorder import RunRecorder
from anm_mj.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    Action,
    ActionResult,
    Candidate,
    Intrinsics,
    MapUpdate,
    Observation,
    OccupancyGrid,
    Plan,
    Pose2,
    Region,
    StopReason,
    TopDownMap,
    VoronoiGraph,
    WheelSpeeds,
)

ROOM_LOW_M, ROOM_HIGH_M = np.array([-2.0, -1.5, 0.0]), np.array([2.0, 1.5, 2.5])
CAMERA = Intrinsics.from_fov(256, 256, math.radians(90.0))


def room() -> trimesh.Trimesh:
    """The inside of a box, 4 x 3 x 2.5 m, its floor at z = 0."""
    mesh = trimesh.creation.box(bounds=[ROOM_LOW_M, ROOM_HIGH_M])
    mesh.invert()
    return mesh


def room_truth(num_samples: int = 2_000) -> GroundTruth:
    mesh = room()
    return GroundTruth.sample(np.asarray(mesh.vertices), np.asarray(mesh.faces), num_samples)


def camera_pose(pose: Pose2, height_m: float = 1.25) -> np.ndarray:
    c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    return np.array([[s, 0.0, c, pose.x_m], [-c, 0.0, s, pose.y_m], [0.0, -1.0, 0.0, height_m], [0.0, 0.0, 0.0, 1.0]])


def room_depth(T_world_camera: np.ndarray, seen: Intrinsics | np.ndarray = CAMERA) -> np.ndarray:
    """Planar depth of the box room's walls, exact, of a camera or along directions with z = 1."""
    rays = (pixel_directions(seen) if isinstance(seen, Intrinsics) else seen) @ T_world_camera[:3, :3].T
    with np.errstate(divide="ignore"):
        to_low = (ROOM_LOW_M - T_world_camera[:3, 3]) / rays
        to_high = (ROOM_HIGH_M - T_world_camera[:3, 3]) / rays
    return np.maximum(to_low, to_high).min(axis=-1).astype(np.float32)


def observe(step: int, pose: Pose2, intrinsics: Intrinsics = CAMERA) -> Observation:
    T_world_camera = camera_pose(pose)
    depth_m = room_depth(T_world_camera, intrinsics)
    rgb = np.full((*depth_m.shape, 3), 128, np.uint8)
    return Observation(step, 0.5 * step, rgb, depth_m, intrinsics, T_world_camera, pose)


def room_plan() -> Plan:
    resolution_m = 0.1
    rows, cols = 34, 44
    state = np.full((rows, cols), UNKNOWN, np.int8)
    state[2:-2, 2:-2] = OCCUPIED
    state[3:-3, 3:-3] = FREE
    row, col = np.mgrid[:rows, :cols]
    clearance_m = (np.minimum.reduce([row - 2, rows - 3 - row, col - 2, cols - 3 - col]) * resolution_m).astype(
        np.float32
    )
    vertices = np.array([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.5, 1.0], [1.5, -1.0]])
    edges = np.array([[0, 1], [1, 2], [2, 3], [2, 4]])
    graph = VoronoiGraph(vertices, np.full(5, 0.5), edges, np.linalg.norm(np.subtract(*vertices[edges.T]), axis=1))
    regions = (
        Region(np.array([1.9, 1.3, 1.0]), np.array([-1.0, 0.0, 0.0]), 40, 2.5, 3),
        Region(np.array([-1.8, -1.2, 0.5]), np.array([1.0, 0.0, 0.0]), 12, 1.5, 0),
    )
    return Plan(
        reason="the nearest place with something left to see",
        path_xy_m=np.array([[0.0, 0.0], [1.0, 0.0], [1.5, 1.0]]),
        headings_rad=(0.3,),
        candidates=(Candidate(np.array([1.5, 1.0]), 2.0, 30.0, 24.0),),
        topdown=TopDownMap(clearance_m, state, resolution_m, np.array([-2.2, -1.7])),
        graph=graph,
        regions=regions,
        stage_ms={"graph": 3.0},
    )


class FakeMap:
    """Stands for the neural map: knows the room exactly."""

    closed = False
    is_trained = True

    def mesh(self, resolution_m: float) -> trimesh.Trimesh:
        mesh = room()
        while mesh.edges_unique_length.max() > 10 * resolution_m:
            mesh = mesh.subdivide()
        mesh.visual.vertex_colors = np.tile([200, 180, 160, 255], (len(mesh.vertices), 1))
        return mesh

    def changes(self):
        return None

    def occupancy_grid(self) -> OccupancyGrid:
        nothing = np.zeros((0, 0, 0))
        return OccupancyGrid(nothing.astype(np.int8), nothing.astype(np.float32), np.zeros(3), 0.05)

    def replay(self, limit_bytes):
        raise AssertionError("nothing is kept for a later run")

    def close(self) -> None:
        self.closed = True

    def save(self, path: Path) -> None:
        path.write_bytes(b"map")


def record_steps(recorder: RunRecorder, num_steps: int, time_scale: float = 1.0) -> None:
    """Turn left twice for every three steps, move on the third; observe after each."""
    pose = Pose2(0.0, 0.0, 0.0)
    recorder.observation(observe(0, pose))
    recorder.plan(0, room_plan())
    for step in range(1, num_steps + 1):
        forward = step % 3 == 0
        action = Action.MOVE_FORWARD if forward else Action.TURN_LEFT
        pose = move_pose(pose, 0.065 if forward else 0.0, 0.0 if forward else math.radians(10.0))
        result = ActionResult(action, step == 6, WheelSpeeds(1.0, 1.5), 0.065 if forward else 0.0)
        update = MapUpdate(loss=1.0 / step, num_iterations=5, num_keyframes=step)
        recorder.step(step, result, pose, update, {"render": time_scale * step})
        recorder.observation(observe(step, pose))


def new_recorder(path: Path, **options: Any) -> RunRecorder:
    return RunRecorder(RunFolder.create(path, "room", "gvg"), room_truth(), **options)


def ended(stop_reason: StopReason, loop_s: float) -> Ended:
    """The end of a loop of which the recorder knows the rest."""
    return Ended(stop_reason, 0, loop_s, observe(0, Pose2(0.0, 0.0, 0.0)))
