"""Figures of people: a few rigid parts each, moved as mocap bodies in a walking gait.

Hips and shoulders swing as sines of the gait's phase, knees bend while a leg swings forward, and the body is as high as
the lower foot asks for: a planar leg of two links (Murray, Drought and Kory, Walking Patterns of Normal Men, 1964, for
the angles). Vacuum robots and the chair are one body each.
"""

import math
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float, Int

from anm_mj.people.crowd import CHAIR, VACUUM, Crowd
from anm_mj.people.door_leaves import LEAF
from anm_mj.people.walking_floor import BODY
from anm_mj.types import Footprint

PREFIX = "person_"
CHAIR_NAME, _VACUUM_NAME, _LEAF_NAME = "pushed_chair", "vacuum_robot_", "door_leaf_"
GROUP = 0
"""Geom group that the camera sees; of what is drawn, only what moves is in it."""
_PARTS = ("body", "left_thigh", "right_thigh", "left_shin", "right_shin", "left_arm", "right_arm")
_SKIN = ((0.94, 0.78, 0.67), (0.80, 0.60, 0.46), (0.55, 0.38, 0.28), (0.36, 0.24, 0.18))
_HAIR = ((0.15, 0.11, 0.09), (0.45, 0.30, 0.16), (0.75, 0.62, 0.36), (0.55, 0.55, 0.56))
_SHIRT = ((0.72, 0.18, 0.18), (0.16, 0.38, 0.62), (0.20, 0.48, 0.30), (0.86, 0.74, 0.30), (0.85, 0.85, 0.82))
_TROUSERS = ((0.16, 0.18, 0.26), (0.38, 0.34, 0.28), (0.24, 0.30, 0.42))
_SHOE, _WOOD = (0.12, 0.11, 0.11), (0.62, 0.44, 0.27)
_SLICES, _STACKS = 12, 8
"""Facets of a round part: a software renderer spends its time on triangles."""
_THIGH, _SHIN = 0.245, 0.285
"""Lengths as shares of the height; the shin ends at the sole."""
_HEEL, _TOE = -0.035, 0.115
"""Ends of the sole before the shin's axis, likewise."""
_HIP_WIDTH, _SHOULDER, _SHOULDER_WIDTH = 0.05, 0.815, 0.125
_HIP_RAD, _KNEE_RAD, _ARM_RAD = math.radians(28.0), math.radians(50.0), math.radians(30.0)
"""Largest swing of a fast walk."""


_Rgb = tuple[float, float, float]
_Part = tuple[str, _Rgb, list[float], list[float]]
"""Shape, colour, half sizes [m] and place [m]."""


class _Pose(NamedTuple):
    """Of a part in its person's frame: place [m] and angle about the axis to the left [rad]."""

    position_m: tuple[float, float, float]
    pitch_rad: float


_AT_ITS_BODY = _Pose((0.0, 0.0, 0.0), 0.0)


def add_figures(spec: mujoco.MjSpec, crowd: Crowd, seed: int) -> None:
    """Add everybody to an uncompiled model, as mocap bodies that the camera sees and the robot runs into."""
    spec.visual.quality.numslices, spec.visual.quality.numstacks = _SLICES, _STACKS
    config = crowd.config
    for number, height_m in enumerate(crowd.height_m[: config.number].tolist()):
        _add_figure(spec, f"{PREFIX}{number}_", height_m, np.random.default_rng([seed, 85, number]))
    for number in range(config.vacuums):
        r, top = VACUUM.radius_m, VACUUM.z_max_m
        parts = [("cylinder", _SHOE, [r, top / 2 - 0.01, 0], [0, 0, top / 2 - 0.01])]
        parts += [("cylinder", _HAIR[3], [r / 3, 0.01, 0], [0, 0, top - 0.01])]
        _add_thing(spec, f"{_VACUUM_NAME}{number}", VACUUM, parts)
    if config.has_chair:
        parts = [("cylinder", _SHIRT[0], [CHAIR.radius_m, 0.02, 0], [0, 0, 0.45])]
        parts += [("box", _HAIR[1], [0.02, 0.02, 0.215], [x, y, 0.215]) for x in (-0.13, 0.13) for y in (-0.13, 0.13)]
        parts += [("box", _HAIR[1], [0.015, 0.115, 0.2], [-0.17, 0, 0.67])]
        _add_thing(spec, CHAIR_NAME, CHAIR, parts)
    for number, length_m in enumerate(crowd.doors.length_m.tolist()):
        _add_leaf(spec, f"{_LEAF_NAME}{number}", length_m)


def _add_thing(spec: mujoco.MjSpec, name: str, space: Footprint, parts: list[_Part]) -> None:
    body = spec.worldbody.add_body(name=name, mocap=True)
    for shape, rgb, size, place in parts:
        _add_geom(body, shape, rgb, size, pos=place)
    _add_space(body, space.radius_m, space.z_max_m)


def _add_leaf(spec: mujoco.MjSpec, name: str, length_m: float) -> None:
    """Its body stands at the hinge, and the leaf reaches along x."""
    body = spec.worldbody.add_body(name=name, mocap=True)
    half_m, middle_m = (LEAF.z_max_m - LEAF.z_min_m) / 2, (LEAF.z_max_m + LEAF.z_min_m) / 2
    size, place = [length_m / 2, LEAF.radius_m, half_m], [length_m / 2, 0, middle_m]
    _add_geom(body, "box", _WOOD, size, pos=place)
    _add_geom(body, "box", _HAIR[3], [0.05, 2 * LEAF.radius_m, 0.01], pos=[length_m - 0.1, 0, 1.0])
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=place, group=3, mass=0.0)


def _add_geom(body: mujoco.MjsBody, shape: str, rgb: _Rgb, size: list[float], **where: list[float]) -> None:
    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{shape.upper()}")
    body.add_geom(type=kind, size=size, rgba=[*rgb, 1.0], group=GROUP, contype=0, conaffinity=0, mass=0.0, **where)


def _add_space(body: mujoco.MjsBody, radius_m: float, height_m: float) -> None:
    """What the robot runs into."""
    kind, half_m = mujoco.mjtGeom.mjGEOM_CYLINDER, height_m / 2
    body.add_geom(type=kind, size=[radius_m, half_m, 0], pos=[0, 0, half_m], group=3, mass=0.0)


def _add_figure(spec: mujoco.MjSpec, name: str, height_m: float, random: np.random.Generator) -> None:
    skin, hair, shirt, trousers = (
        colours[random.integers(len(colours))] for colours in (_SKIN, _HAIR, _SHIRT, _TROUSERS)
    )
    sleeves = shirt if random.random() < 0.5 else skin
    broad = float(random.uniform(0.9, 1.15))
    h = height_m
    bodies = {part: spec.worldbody.add_body(name=name + part, mocap=True) for part in _PARTS}

    def add(part: str, shape: str, rgb: _Rgb, size: list[float], **where: list[float]) -> None:
        _add_geom(bodies[part], shape, rgb, size, **where)

    add("body", "ellipsoid", trousers, [0.075 * broad * h, 0.10 * broad * h, 0.07 * h], pos=[0, 0, 0.545 * h])
    add("body", "ellipsoid", shirt, [0.07 * broad * h, 0.125 * broad * h, 0.17 * h], pos=[0, 0, 0.69 * h])
    add("body", "capsule", skin, [0.03 * h, 0, 0], fromto=[0, 0, 0.83 * h, 0, 0, 0.88 * h])
    add("body", "ellipsoid", skin, [0.055 * h, 0.047 * h, 0.068 * h], pos=[0.01 * h, 0, 0.932 * h])
    add("body", "ellipsoid", hair, [0.057 * h, 0.05 * h, 0.06 * h], pos=[-0.008 * h, 0, 0.945 * h])
    for side in ("left", "right"):
        add(f"{side}_thigh", "capsule", trousers, [0.045 * h, 0, 0], fromto=[0, 0, 0, 0, 0, -_THIGH * h])
        add(f"{side}_shin", "capsule", trousers, [0.033 * h, 0, 0], fromto=[0, 0, 0, 0, 0, -(_SHIN - 0.05) * h])
        foot = [(_TOE - _HEEL) / 2 * h, 0.027 * h, 0.02 * h]
        add(f"{side}_shin", "box", _SHOE, foot, pos=[(_TOE + _HEEL) / 2 * h, 0, -(_SHIN - 0.02) * h])
        elbow = [0.02 * h, 0, -0.17 * h]
        add(f"{side}_arm", "capsule", sleeves, [0.03 * h, 0, 0], fromto=[0, 0, 0, *elbow])
        add(f"{side}_arm", "capsule", skin, [0.024 * h, 0, 0], fromto=[*elbow, 0.07 * h, 0, -0.33 * h])
    _add_space(bodies["body"], BODY.radius_m, h)


class Figures:
    """Writes where everybody is into the state of a simulation."""

    def __init__(self, model: mujoco.MjModel, crowd: Crowd) -> None:
        """Look up the figures of a crowd in a model."""
        config = crowd.config
        names = [[f"{PREFIX}{number}_{part}" for part in _PARTS] for number in range(config.number)]
        names += [[f"{_VACUUM_NAME}{number}"] for number in range(config.vacuums)] + [[CHAIR_NAME]] * config.has_chair
        leaves = [[f"{_LEAF_NAME}{number}"] for number in range(len(crowd.doors))]
        self._mocap, self._leaves = (
            [[int(model.body_mocapid[model.body(part).id]) for part in parts] for parts in bodies]
            for bodies in (names, leaves)
        )

    def write(self, crowd: Crowd, data: mujoco.MjData) -> None:
        """Place and pose everybody in a state of the model."""
        for number, (x_m, y_m, yaw_rad, phase_rad, swing) in enumerate(states_of(crowd).tolist()):
            is_person = number < crowd.config.number
            poses = _gait(crowd.height_m[number], phase_rad, swing) if is_person else [_AT_ITS_BODY]
            self._write_one(self._mocap[number], (x_m, y_m, yaw_rad), poses, data)
        for leaf, (x_m, y_m, yaw_rad, _) in zip(self._leaves, crowd.doors.states.tolist(), strict=True):
            self._write_one(leaf, (x_m, y_m, yaw_rad), [_AT_ITS_BODY], data)

    @staticmethod
    def _write_one(
        mocap: list[int], where: tuple[float, float, float], poses: list[_Pose], data: mujoco.MjData
    ) -> None:
        x_m, y_m, yaw_rad = where
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        for place, pose in zip(mocap, poses, strict=True):
            px, py, pz = pose.position_m
            data.mocap_pos[place] = x_m + c * px - s * py, y_m + s * px + c * py, pz
            cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
            cp, sp = math.cos(pose.pitch_rad / 2), math.sin(pose.pitch_rad / 2)
            data.mocap_quat[place] = cy * cp, -sy * sp, cy * sp, sy * cp


def standing_bodies(model: mujoco.MjModel) -> Int[np.ndarray, " n"]:
    """Ids of what moves seldom and is surface while it stands: the chair and the leaves of doors."""
    names = [model.body(body).name for body in range(model.nbody)]
    return np.flatnonzero([name == CHAIR_NAME or name.startswith(_LEAF_NAME) for name in names])


def states_of(crowd: Crowd) -> Float[np.ndarray, "n 5"]:
    """Of people, vacuum robots, then the chair: x [m], y [m], yaw [rad], phase of the gait [rad], swing."""
    return np.column_stack([crowd.xy_m, crowd.yaw_rad, crowd.phase_rad, crowd.swing])


def _gait(height_m: float, phase_rad: float, swing: float) -> list[_Pose]:
    """Poses of all parts; a positive angle swings a limb that hangs down to the back."""
    legs = [_leg(phase_rad, swing), _leg(phase_rad + math.pi, swing)]
    hip_z = height_m * max(
        _THIGH * math.cos(hip) + _SHIN * math.cos(hip + knee) + end * math.sin(hip + knee)
        for hip, knee in legs
        for end in (_HEEL, _TOE)
    )
    down = hip_z - (_THIGH + _SHIN) * height_m
    poses = [_Pose((0.0, 0.0, down), 0.0)]
    sides = (_HIP_WIDTH * height_m, -_HIP_WIDTH * height_m)
    poses += [_Pose((0.0, side, hip_z), hip) for side, (hip, _) in zip(sides, legs, strict=True)]
    for side, (hip, knee) in zip(sides, legs, strict=True):
        thigh_m = _THIGH * height_m
        poses.append(_Pose((-thigh_m * math.sin(hip), side, hip_z - thigh_m * math.cos(hip)), hip + knee))
    shoulder_z = _SHOULDER * height_m + down
    for sign, (hip, _) in zip((1.0, -1.0), legs, strict=True):
        poses.append(_Pose((0.0, sign * _SHOULDER_WIDTH * height_m, shoulder_z), -hip * _ARM_RAD / _HIP_RAD))
    return poses


def _leg(phase_rad: float, swing: float) -> tuple[float, float]:
    """Angles of a hip and of a knee [rad], to the back; the hip is foremost at a quarter of a turn."""
    hip = -_HIP_RAD * swing * math.sin(phase_rad)
    # The knee bends while the leg swings forward.
    return hip, _KNEE_RAD * swing * max(math.cos(phase_rad), 0.0) ** 2
