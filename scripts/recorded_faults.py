"""Simulated recordings for scripts/check_sequences.py: walks through scenes, and what can go wrong with them.

A walk is rendered from poses along the way of an exploration: by a robot that moves in steps, or by a camera in a hand.
A fault changes what the recording states about itself; the images are then those of a sound one.
"""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from anm_mj.config import make_config
from anm_mj.events import Observed, On
from anm_mj.explore import explore
from anm_mj.frames import T_GL_CV
from anm_mj.io.sequence import Frame, Sequence
from anm_mj.io.sequence_poses import at_times
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import make_policy
from anm_mj.scene.folder import load_scene
from anm_mj.sequence_check.correction import Correction, all_axes, axes_matrix, inverse, is_left_handed
from anm_mj.sequence_check.find_faults import UNITS_M
from anm_mj.sim.gl import select_backend
from anm_mj.sim.sensors.camera_sensor import Sensor
from anm_mj.sim.sensors.sensor_config import sensor_config
from anm_mj.types import Intrinsics

WIDTH_PX, HEIGHT_PX = 160, 120
FRAME_S, DENSE = 1.0 / 15.0, 2
"""Frames of a hand-held recording are so far apart [s]; colour is rendered so many times as often."""
FRAMES = 60
_STEP_S = 0.5
"""From one step of the robot to the next [s]."""


@dataclass(frozen=True)
class Walk:
    """A recording as it truly was."""

    name: str
    camera: Intrinsics
    times_s: np.ndarray
    """Of the frames."""
    poses: np.ndarray
    """Of the frames' cameras, x right, y down, z forward."""
    rgb: np.ndarray
    """At dense times."""
    depth_m: np.ndarray
    """Of the frames."""
    track_s: np.ndarray
    """Times of the dense poses."""
    track: np.ndarray
    """Dense poses."""


@dataclass(frozen=True)
class Recording:
    """A walk with its disturbances and its fault."""

    sequence: Sequence
    fault: str = ""
    """Its kind, as the check calls it; empty = sound."""
    size: str = ""
    """How wrong, in words."""
    expected: Correction = field(default_factory=Correction)


def way(scene: str, seed: int, steps: int) -> list[tuple[float, float, float]]:
    """Poses x, y, yaw of a robot that explores a scene."""
    select_backend()
    from anm_mj.sim.make_robot import make_robot

    poses: list[tuple[float, float, float]] = []
    config = make_config("quick", [], scene=scene, steps=steps, seed=seed)

    def keep(event: Observed) -> None:
        pose = event.observation.pose
        poses.append((pose.x_m, pose.y_m, pose.yaw_rad))

    with make_robot(load_scene(scene), image_px=64) as robot:
        context = PolicyContext(robot.footprint, config.policy_settings, config.planning, seed)
        mapper = NeuralMap(config.mapping, seed=seed, device="cpu")
        explore(robot, mapper, make_policy("gvg", context), num_steps=steps, observers=(On(Observed, keep),))
    return poses


def walks(scene: str, seed: int) -> list[Walk]:
    """A robot's recording and a hand-held one of a scene."""
    steps = way(scene, seed, 160)
    rng = np.random.default_rng([seed, 11])
    first = int(rng.integers(20, len(steps) - FRAMES))
    robot = np.array([_level(x, y, yaw, 1.25, -10.0) for x, y, yaw in steps[first : first + FRAMES]])
    times = np.arange(FRAMES) * _STEP_S
    camera = Intrinsics.from_fov(WIDTH_PX, HEIGHT_PX, math.radians(70.0))
    track_s, track = _hand_track(steps, rng)
    return [
        _rendered(f"{scene}-robot", scene, camera, times, robot, times, robot),
        _rendered(f"{scene}-hand", scene, camera, track_s[::DENSE], track[::DENSE], track_s, track),
    ]


def _level(x: float, y: float, yaw: float, height: float, pitch_deg: float, roll_deg: float = 0.0) -> np.ndarray:
    """A camera that looks along a yaw."""
    T = np.eye(4)
    ahead = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
    T[:3, :3] = np.stack((right, [0.0, 0.0, -1.0], ahead), axis=1)
    T[:3, :3] = T[:3, :3] @ Rotation.from_euler("xz", (pitch_deg, roll_deg), degrees=True).as_matrix()
    T[:3, 3] = (x, y, height)
    return T


def _hand_track(steps: list[tuple[float, float, float]], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Dense poses of a camera in a hand along the way: walking speed, a turning wrist."""
    at = np.array(steps)
    at[:, 2] = np.unwrap(at[:, 2])
    at = gaussian_filter1d(at, 2.0, axis=0)
    length = np.cumsum(np.r_[0.0, np.hypot(*np.diff(at[:, :2], axis=0).T) / 0.45 + np.abs(np.diff(at[:, 2])) / 0.8])
    spline = CubicSpline(length + 1e-6 * np.arange(len(length)), at)
    count = FRAMES * DENSE
    span = (count - 1) * FRAME_S / DENSE
    begin = float(rng.uniform(0.1, 0.9)) * max(length[-1] - span, 0.0)
    times = np.arange(count) * FRAME_S / DENSE
    sway = [
        amount * np.sin(2 * math.pi * rate * times + rng.uniform(0, 2 * math.pi))
        for amount, rate in ((0.05, 0.9), (6.0, 0.5), (3.0, 0.7), (0.10, 0.35), (0.03, 1.1))
    ]
    poses = []
    for k, time in enumerate(times):
        x, y, yaw = spline(min(begin + time, length[-1]))
        yaw += sway[3][k]
        poses.append(_level(x + sway[4][k], y, yaw, 1.35 + sway[0][k], -12.0 + sway[1][k], sway[2][k]))
    return times, np.array(poses)


def _rendered(
    name: str,
    scene: str,
    camera: Intrinsics,
    times: np.ndarray,
    poses: np.ndarray,
    track_s: np.ndarray,
    track: np.ndarray,
) -> Walk:
    # MuJoCo must not be imported before its GL back-end is chosen.
    backend = select_backend()
    import mujoco

    from anm_mj.scene.build import build_spec, compile_scene
    from anm_mj.sim.camera_factory import make_camera

    loaded = load_scene(scene)
    spec = build_spec(loaded)
    eye = spec.worldbody.add_body(name="eye", mocap=True)
    fov_y_deg = math.degrees(2.0 * math.atan(camera.height / 2.0 / camera.fy))
    eye.add_camera(name="eye", fovy=fov_y_deg)
    model = compile_scene(spec, loaded)
    data = mujoco.MjData(model)
    colours, depths = [], []
    with closing(
        make_camera(model, "eye", camera.width, camera.height, cull_face=loaded.cull_face, backend=backend)
    ) as eyes:
        for T in track:
            turned = T @ T_GL_CV
            data.mocap_pos[0] = turned[:3, 3]
            mujoco.mju_mat2Quat(data.mocap_quat[0], turned[:3, :3].ravel())
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            rgb, depth_m = eyes.render(data)
            colours.append(rgb.copy())
            depths.append(depth_m.astype(np.float32))
    every = len(track) // len(poses)
    return Walk(name, camera, times, poses, np.array(colours), np.array(depths[::every]), track_s, track)


def sound(walk: Walk, rng: np.random.Generator, *, sensor: str, drift: float, moving: bool) -> Recording:
    """A recording with what every sound one has: noise, drift, things that move."""
    rgb, depth = walk.rgb, walk.depth_m
    if moving:
        rgb, depth = _with_person(walk, rng)
    poses = _drifted(walk.poses, drift, rng) if drift else walk.poses
    measured = Sensor(sensor_config(sensor), int(rng.integers(1 << 30)))
    every = len(rgb) // len(depth)
    return Recording(_sequence(walk, poses, walk.times_s, rgb[::every], depth, measured, 1.0))


def _sequence(
    walk: Walk,
    poses: np.ndarray,
    times: np.ndarray,
    rgb: np.ndarray,
    depth: np.ndarray,
    sensor: Sensor,
    scale: float,
    *,
    flip: bool = False,
    stated: Intrinsics | None = None,
    unit_m: float = 0.001,
) -> Sequence:
    def colour(k: int) -> np.ndarray:
        image = sensor.measure(rgb[k], depth[k], walk.camera, k)[0]
        return image[:, ::-1].copy() if flip else image

    def metres(k: int) -> np.ndarray:
        image = sensor.measure(rgb[k], depth[k], walk.camera, k)[1]
        image = np.where(np.isfinite(image), image * np.float32(scale), np.float32(np.nan))
        return image[:, ::-1].copy() if flip else image

    frames = tuple(
        Frame(float(times[k]), lambda k=k: colour(k), lambda k=k: metres(k), poses[k]) for k in range(len(poses))
    )
    return Sequence(Path(walk.name), stated or walk.camera, unit_m, frames)


def _drifted(poses: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Poses of an odometry whose steps are wrong by a share of their size."""
    found = [poses[0]]
    bias = rng.choice((-1.0, 1.0), 2) * share
    for one, other in pairwise(poses):
        step = inverse(one[None])[0] @ other
        turn = Rotation.from_matrix(step[:3, :3]).as_rotvec()
        step[:3, :3] = Rotation.from_rotvec(turn * (1.0 + bias[0])).as_matrix()
        step[:3, 3] *= 1.0 + bias[1]
        found.append(found[-1] @ step)
    return np.array(found)


def _with_person(walk: Walk, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Images with a person (an upright cylinder) who walks before the camera."""
    k = walk.camera
    u = (np.arange(k.width) + 0.5 - k.cx) / k.fx
    v = (np.arange(k.height) + 0.5 - k.cy) / k.fy
    rays = np.stack((*np.meshgrid(u, v), np.ones((k.height, k.width))), axis=-1)
    rgb, depth = walk.rgb.copy(), walk.depth_m.copy()
    every = len(rgb) // len(depth)
    shade = rng.integers(40, 220, 3)
    phase = rng.uniform(0, 2 * math.pi)
    for n, T in enumerate(walk.track):
        frame = n // every
        side = math.sin(phase + 1.3 * walk.track_s[n])
        centre = (T @ np.array([side * 1.2, 0.0, 1.8, 1.0]))[:2]
        d = rays @ T[:3, :3].T
        o = T[:3, 3]
        a = (d[..., :2] ** 2).sum(-1)
        b = (d[..., :2] * (o[:2] - centre)).sum(-1)
        c = float(((o[:2] - centre) ** 2).sum()) - 0.22**2
        inside = b * b - a * c
        with np.errstate(invalid="ignore"):
            z = (-b - np.sqrt(inside)) / a
            height = o[2] + z * d[..., 2]
            behind = walk.depth_m[min(frame, len(depth) - 1)]
            hit = (inside > 0.0) & (z > 0.2) & (height > 0.0) & (height < 1.75) & ~(behind < z)
        rgb[n][hit] = (shade * (0.6 + 0.4 * np.sin(9.0 * height[hit]))[:, None]).astype(np.uint8)
        if n % every == 0 and frame < len(depth):
            depth[frame][hit] = z[hit]
    return rgb, depth


KINDS = ("poses", "axes", "mirrored", "ray", "scale", "unit", "focal", "time", "colour", "up")


def faulty(walk: Walk, rng: np.random.Generator, kind: str, *, sensor: str, drift: float, moving: bool) -> Recording:
    """A recording with one fault of a kind; its size is drawn from hardly to grossly wrong."""
    rgb, depth = _with_person(walk, rng) if moving else (walk.rgb, walk.depth_m)
    every = len(rgb) // len(depth)
    poses = _drifted(walk.poses, drift, rng) if drift else walk.poses
    measured = Sensor(sensor_config(sensor), int(rng.integers(1 << 30)))
    colours, scale, flip, stated, unit_m = rgb[::every], 1.0, False, walk.camera, 0.001
    size, expected, sign = "", Correction(), float(rng.choice((-1.0, 1.0)))
    if kind == "poses":
        convention = str(rng.choice(["world-to-camera", "scalar-first", "conjugate"]))
        expected, size = Correction(convention=convention), convention
        if convention == "world-to-camera":
            poses = inverse(poses)
        elif convention == "conjugate":
            poses = poses.copy()
            poses[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
        else:
            quaternion = Rotation.from_matrix(poses[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]]
            poses = poses.copy()
            poses[:, :3, :3] = Rotation.from_quat(quaternion).as_matrix()
    elif kind == "axes":
        proper = [axes for axes in all_axes() if not is_left_handed(axes) and axes != "RDF"]
        axes = str(rng.choice(["RUB", "FLU", "FRD"])) if rng.random() < 0.6 else str(rng.choice(proper))
        expected, size = Correction(axes=axes), axes
        turn = np.eye(4)
        turn[:3, :3] = axes_matrix(axes)
        poses = poses @ turn
    elif kind == "mirrored":
        flip, expected, size = True, Correction(mirrored=True), "images"
    elif kind == "ray":
        u = (np.arange(walk.camera.width) + 0.5 - walk.camera.cx) / walk.camera.fx
        v = (np.arange(walk.camera.height) + 0.5 - walk.camera.cy) / walk.camera.fy
        depth = depth * np.sqrt(1.0 + u[None, :] ** 2 + v[:, None] ** 2).astype(np.float32)
        expected, size = Correction(ray_depth=True), "distances"
    elif kind == "scale":
        factor = math.exp(sign * math.exp(rng.uniform(math.log(0.03), math.log(1.6))))
        poses = poses.copy()
        poses[:, :3, 3] *= factor
        expected, size = Correction(pose_scale=1.0 / factor), f"x {factor:.3f}"
    elif kind == "unit":
        true_unit, said = rng.choice(len(UNITS_M), 2, replace=False)
        scale, unit_m = UNITS_M[said] / UNITS_M[true_unit], UNITS_M[said]
        expected, size = Correction(depth_scale=1.0 / scale), f"x {scale:.4g}"
    elif kind == "focal":
        factor = math.exp(sign * math.exp(rng.uniform(math.log(0.03), math.log(0.6))))
        stated = replace(walk.camera, fx=walk.camera.fx * factor, fy=walk.camera.fy * factor)
        expected, size = Correction(focal_scale=1.0 / factor), f"x {factor:.3f}"
    elif kind == "time":
        frame = float(np.median(np.diff(walk.times_s)))
        offset = sign * math.exp(rng.uniform(math.log(0.02), math.log(0.4))) * (1.0 if frame < 0.2 else 2.0)
        poses = at_times(walk.track, walk.track_s, walk.times_s - offset)
        expected, size = Correction(time_offset_s=offset), f"{offset * 1000:.0f} ms"
    elif kind == "colour":
        frames = int(sign) * int(rng.integers(1, 6))
        interval = float(walk.track_s[1] - walk.track_s[0])
        index = np.clip(np.arange(len(depth)) * every - frames, 0, len(rgb) - 1)
        colours = rgb[index]
        expected, size = Correction(colour_offset_s=-frames * interval), f"{-1000 * frames * interval:.0f} ms"
    elif kind == "up":
        up = str(rng.choice(["y", "-y", "-z"]))
        turn = {
            "y": (1, 0, 0, 0, 0, 1, 0, -1, 0),
            "-y": (1, 0, 0, 0, 0, -1, 0, 1, 0),
            "-z": (1, 0, 0, 0, -1, 0, 0, 0, -1),
        }[up]
        T = np.eye(4)
        T[:3, :3] = np.array(turn, float).reshape(3, 3)
        poses, expected, size = T @ poses, Correction(up=up), up
    sequence = _sequence(
        walk, poses, walk.times_s, colours, depth, measured, scale, flip=flip, stated=stated, unit_m=unit_m
    )
    return Recording(sequence, kind, size, expected)
