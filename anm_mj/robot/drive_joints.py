"""Finds the joints that drive a robot: two wheels, the wheels of a skid-steered base, or planar joints."""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.errors import RobotError
from anm_mj.robot.compiled_robot import joints_above, lowest_m, subtree
from anm_mj.robot.robot_config import RobotConfig

HOLONOMIC = "holonomic"
DIFFERENTIAL = "differential"
SKID_STEER = "skid steer"
_LEVEL = math.sin(math.radians(8.0))
_NEAR_FLOOR_M = 0.03
"""A wheel reaches down to within this distance of the robot's lowest point [m]."""
_ON_JOINT = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
_WHEEL = {"wheel", "wheels", "whl", "drivewhl", "tire", "tyre"}
_LEFT = {"left", "l", "lh", "lft", "port", "fl", "rl", "bl", "ml", "lf", "lb", "lr"}
_RIGHT = {"right", "r", "rh", "rgt", "starboard", "fr", "rr", "br", "mr", "rf", "rb"}
_PASSIVE = {"caster", "castor", "suspension", "steer", "steering", "swivel", "roller", "ball", "omni"}
_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_PREFIXES = ("left", "right", "wheel")
_ENDINGS = ("wheel", "caster", "castor")


@dataclass(frozen=True)
class DriveJoints:
    """The joints that drive a robot."""

    kind: str
    """``differential``, ``skid steer`` or ``holonomic``."""
    root: str
    left: tuple[str, ...] = ()
    """Hinges of the left wheels; of a skid-steered base the front one first."""
    right: tuple[str, ...] = ()
    planar: tuple[str, ...] = ()
    """Joints of a holonomic base: two slides and a hinge."""


def find_drive_joints(
    model: mujoco.MjModel, data: mujoco.MjData, config: RobotConfig, path: Path, ahead: Float[np.ndarray, "3"] | None
) -> DriveJoints:
    """Find the driven wheels, or the planar joints.

    Names given in the configuration count first, then the names of the joints, then which actuated hinges stand on the
    floor. All bodies and joints of the model are named; ``ahead`` is the horizontal direction of the robot's camera in
    the world, None = unknown. Raises RobotError if the file has no such parts, too many driven wheels, or parts of
    several robots.
    """
    joints = [model.joint(j).name for j in range(model.njnt)]
    given = [
        _given(model, names, side, path) for names, side in ((config.left_wheel, "left"), (config.right_wheel, "right"))
    ]
    on_floor = _wheels_on_floor(model, data)
    driven = [j for j, swivels in on_floor if not swivels and _is_actuated(model, j)]
    named = {side: _named(model, side, driven) for side in ("left", "right")}
    if not any(given):
        planar = _planar_joints(model, data)
        if planar and not driven:
            if config.skid_steer:
                raise RobotError(
                    f"model.skid_steer is set, but {path} moves by planar joints ({_listed(joints, planar)}); leave it "
                    "out."
                )
            root = model.body_rootid[model.jnt_bodyid[planar[0]]]
            return DriveJoints(HOLONOMIC, model.body(root).name, planar=tuple(joints[j] for j in planar))
        steered = sorted({j for _, swivels in on_floor for j in swivels if _is_actuated(model, j)})
        if steered:
            raise RobotError(
                f"The robot {path} steers its wheels ({_listed(joints, steered)}), like a car, and cannot turn on the "
                "spot; name two wheels that drive it with the steering locked by --set model.left_wheel=NAME --set "
                "model.right_wheel=NAME, or give the base planar joints (two slides and a hinge) where it can move in "
                "any direction."
            )
    left, right = given[0] or named["left"], given[1] or named["right"]
    if len(driven) > 2 or len(left) > 1 or len(right) > 1:
        all_driven = sorted({*driven, *left, *right})
        if not config.skid_steer:
            names = ", ".join(joints[j] for j in all_driven)
            raise RobotError(
                f"The robot {path} has {len(all_driven)} driven wheels ({names}); two "
                "drive a base. Where all wheels of a side turn alike and slip in turns, say so by --set "
                "model.skid_steer=true."
            )
        if not all(given):
            left, right = _sides(model, data, all_driven, path, ahead)
        if len(left) != len(right):
            raise RobotError(
                f"The robot {path} has {len(left)} wheels on its left ({_listed(joints, left)}) and {len(right)} on "
                f"its right ({_listed(joints, right)}); name as many on either side by --set "
                "model.left_wheel=A,B --set model.right_wheel=C,D."
            )
    elif config.skid_steer:
        raise RobotError(
            f"model.skid_steer is set, but {path} has {len(driven)} driven wheel{'s' * (len(driven) != 1)} that stand "
            "on the floor; leave it out, or name all wheels by --set model.left_wheel=A,B --set model.right_wheel=C,D."
        )
    elif len(driven) == 2 and not (left and right) and not any(given):
        left, right = _sides(model, data, driven, path, ahead)
    if not left or not right:
        raise RobotError(_lacking(model, left, right, driven, path))
    for joint in (*left, *right):
        _require_hinge(model, joint, path)
    roots = {int(model.body_rootid[model.jnt_bodyid[j]]) for j in (*left, *right)}
    if len(roots) > 1:
        raise RobotError(
            f"The wheels of {path} hang on different bodies of the world "
            f"({', '.join(model.body(r).name for r in sorted(roots))}); a robot is one body with everything on it. "
            "Files made from a URDF lack that body where the base was fused with the world."
        )
    kind = SKID_STEER if len(left) > 1 else DIFFERENTIAL
    return DriveJoints(
        kind, model.body(roots.pop()).name, tuple(joints[j] for j in left), tuple(joints[j] for j in right)
    )


def side_of(name: str) -> str:
    """``left`` or ``right`` for the name of a wheel on that side; ``wheel`` for another wheel; else empty.

    ``joint_left_wheel``, ``wheel_left_joint``, ``leftWheel``, ``fl_wheel``, ``robot/l_wheel_joint`` are left wheels.
    Casters, suspensions and steering joints are none.
    """
    words = set(_words(name))
    if words & _PASSIVE or not words & _WHEEL:
        return ""
    left, right = bool(words & _LEFT), bool(words & _RIGHT)
    if left == right:
        return "wheel"
    return "left" if left else "right"


def is_passive(name: str) -> bool:
    """Whether a name is that of a caster, a suspension or a steering joint."""
    return bool(set(_words(name)) & _PASSIVE)


def _words(name: str) -> list[str]:
    """Lower-case words of a name; words written together, such as ``leftwheel``, are split."""
    found = []
    for word in (match.lower() for match in _WORDS.findall(name)):
        while prefix := next((p for p in _PREFIXES if word.startswith(p) and word not in (p, "wheels")), None):
            found.append(prefix)
            word = word[len(prefix) :]
        ends_in = next((end for end in _ENDINGS if word.endswith(end) and word != end), None)
        found += [word[: -len(ends_in)], ends_in] if ends_in else [word]
    return found


def _given(model: mujoco.MjModel, names: str, side: str, path: Path) -> list[int]:
    found = []
    for name in (part.strip() for part in names.split(",") if part.strip()):
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        if joint < 0:
            raise RobotError(
                f'The robot {path} has no hinge "{name}"; its hinges are {_hinges(model)}: name one by --set '
                f"model.{side}_wheel=NAME."
            )
        _require_hinge(model, joint, path)
        found.append(joint)
    return found


def _require_hinge(model: mujoco.MjModel, joint: int, path: Path) -> None:
    if model.jnt_type[joint] != _HINGE:
        raise RobotError(
            f'The joint "{model.joint(joint).name}" of {path} is no hinge; a wheel turns about one. Hinges: '
            f"{_hinges(model)}."
        )


def _named(model: mujoco.MjModel, side: str, driven: list[int]) -> list[int]:
    """Joints that a name calls wheels of a side; of several the driven ones, or those that can roll: suspensions have
    such names too.
    """
    found = []
    for joint in range(model.njnt):
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            continue
        own = model.joint(joint).name
        named = side_of(own)
        if not named and not is_passive(own) and model.jnt_type[joint] == _HINGE and not model.jnt_limited[joint]:
            named = side_of(model.body(int(model.jnt_bodyid[joint])).name)
        if named == side:
            found.append(joint)
    rolling = [j for j in found if model.jnt_type[j] == _HINGE and not model.jnt_limited[j]]
    chosen = [j for j in found if j in driven] or rolling
    return chosen if len(found) > 1 and chosen else found


def _wheels_on_floor(model: mujoco.MjModel, data: mujoco.MjData) -> list[tuple[int, list[int]]]:
    """Level hinges without a range whose bodies reach the floor, each with the upright hinges that it hangs on."""
    found = []
    for joint in range(model.njnt):
        if model.jnt_type[joint] != _HINGE or model.jnt_limited[joint] or is_passive(model.joint(joint).name):
            continue
        body = int(model.jnt_bodyid[joint])
        geoms = np.flatnonzero(np.isin(model.geom_bodyid, subtree(model, body))).tolist()
        others = [j for j in joints_above(model, body) if j != joint]
        root = int(model.body_rootid[body])
        swivels = [
            j
            for j in others
            if model.jnt_type[j] == _HINGE and abs(data.xaxis[j][2]) > 0.9 and model.jnt_bodyid[j] != root
        ]
        if abs(data.xaxis[joint][2]) > _LEVEL or not geoms:
            continue
        lowest = lowest_m(model, data, geoms)
        floor = lowest_m(model, data, np.flatnonzero(model.body_rootid[model.geom_bodyid] == root).tolist())
        if lowest < floor + _NEAR_FLOOR_M and lowest < data.xanchor[joint][2]:
            found.append((joint, swivels))
    return found


def _is_actuated(model: mujoco.MjModel, joint: int) -> bool:
    return any(
        mujoco.mjtTrn(model.actuator_trntype[a]) in _ON_JOINT and model.actuator_trnid[a, 0] == joint
        for a in range(model.nu)
    )


def _planar_joints(model: mujoco.MjModel, data: mujoco.MjData) -> list[int]:
    """Two level slides across each other and an upright hinge at the root of one tree; empty without."""
    for root in (b for b in range(1, model.nbody) if model.body_parentid[b] == 0):
        found: list[int] = []
        body = root
        while True:
            own = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
            planar = [j for j in own if _is_planar(model, data, j)]
            found += planar
            children = [b for b in range(1, model.nbody) if model.body_parentid[b] == body]
            if len(found) >= 3 or len(planar) < len(own) or len(children) != 1:
                break
            body = children[0]
        slides = [j for j in found if model.jnt_type[j] == _SLIDE]
        hinges = [j for j in found if model.jnt_type[j] == _HINGE]
        if len(slides) == 2 and len(hinges) == 1 and abs(data.xaxis[slides[0]] @ data.xaxis[slides[1]]) < 0.1:
            return found
    return []


def _is_planar(model: mujoco.MjModel, data: mujoco.MjData, joint: int) -> bool:
    up = abs(float(data.xaxis[joint][2]))
    return bool(model.jnt_type[joint] == _SLIDE and up < _LEVEL) or (model.jnt_type[joint] == _HINGE and up > 0.99)


def _sides(
    model: mujoco.MjModel, data: mujoco.MjData, wheels: list[int], path: Path, ahead: Float[np.ndarray, "3"] | None
) -> tuple[list[int], list[int]]:
    """Left and right wheels, each from the front backwards; by name, or else by where they stand."""
    names = [model.joint(j).name for j in wheels]
    axis = data.xaxis[wheels[0]]
    if any(abs(data.xaxis[j] @ axis) < 0.99 for j in wheels):
        raise RobotError(
            f"The driven wheels of {path} ({', '.join(names)}) turn about axles of different directions, like "
            "omnidirectional wheels; give the base planar joints (two slides and a hinge) instead."
        )
    across = np.array([axis[0], axis[1], 0.0]) / np.hypot(axis[0], axis[1])
    forward = np.cross(across, [0.0, 0.0, 1.0])
    where = np.array([data.xanchor[j] for j in wheels])
    sides = [side_of(name) for name in names]
    if {"left", "right"} == set(sides):
        is_left = np.array([side == "left" for side in sides])
        if (where[is_left].mean(axis=0) - where[~is_left].mean(axis=0)) @ across < 0.0:
            forward = -forward
    else:
        axes = data.xmat[model.body_rootid[model.jnt_bodyid[wheels[0]]]].reshape(3, 3)
        guess = ahead if ahead is not None and abs(ahead @ forward) > 0.5 else axes[:, 0]
        guess = guess if abs(guess @ forward) > 0.5 else axes[:, 1]
        if guess @ forward < 0.0:
            forward, across = -forward, -across
        aside = (where - where.mean(axis=0)) @ across
        is_left = aside > 0.0
    order = np.argsort(-(where @ forward), kind="stable")
    return [wheels[i] for i in order if is_left[i]], [wheels[i] for i in order if not is_left[i]]


def _lacking(model: mujoco.MjModel, left: list[int], right: list[int], driven: list[int], path: Path) -> str:
    hinges = _hinges(model)
    if not left and not right and not driven:
        return (
            f"The robot {path} has no wheels: no hinge named like wheel_left or left_wheel_joint, none with an "
            f"actuator that stands on the floor, and no planar joints; its hinges are {hinges}: name two by --set "
            "model.left_wheel=NAME --set model.right_wheel=NAME."
        )
    if len(driven) == 1 and not (left and right) and len({*left, *right, *driven}) == 1:
        only = model.joint(driven[0]).name
        return (
            f"The robot {path} has one driven wheel ({only}); a base needs two, or planar joints. Its hinges are "
            f"{hinges}: name the wheels by --set model.left_wheel=NAME --set model.right_wheel=NAME."
        )
    side = "left" if not left else "right"
    return (
        f"The robot {path} has no {side} wheel (a hinge named wheel_{side}, {side}_wheel or alike); its hinges are "
        f"{hinges}: name one by --set model.{side}_wheel=NAME."
    )


def _hinges(model: mujoco.MjModel) -> str:
    return ", ".join(model.joint(j).name for j in range(model.njnt) if model.jnt_type[j] == _HINGE) or "none"


def _listed(names: list[str], chosen: list[int]) -> str:
    return ", ".join(names[j] for j in chosen) or "none"
