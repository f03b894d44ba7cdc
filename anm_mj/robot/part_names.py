"""Finds a robot's wheels and camera by name in its MJCF and removes everything else from the spec."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco

from anm_mj.errors import RobotError
from anm_mj.robot.config import RobotConfig

LEFT_WHEELS = ("wheel_left", "left_wheel", "wheel_left_joint", "left_wheel_joint")
"""Default names of a left wheel's hinge."""
RIGHT_WHEELS = tuple(name.replace("left", "right") for name in LEFT_WHEELS)
CAMERA = "camera"
ROBOT_GROUP = 1
"""Group of the robot's geoms: visible in viewers, hidden from the robot's own camera."""


@dataclass(frozen=True)
class RobotParts:
    """Names of a robot's parts."""

    root: str
    """The robot's top-level body."""
    base_joint: str
    wheels: tuple[str, str]
    """Left, right."""
    camera: str


def find_parts(spec: mujoco.MjSpec, config: RobotConfig, path: Path) -> RobotParts:
    """Look up the parts, name unnamed bodies, and give the base a named free joint.

    A free joint replaces other joints of the base, together with their actuators.

    Raises:
        RobotError: if a part is missing, or the parts belong to different robots.
    """
    _name_all(spec.bodies, "body")
    left = _wheel(spec, config.left_wheel, LEFT_WHEELS, "left", path)
    right = _wheel(spec, config.right_wheel, RIGHT_WHEELS, "right", path)
    camera = _camera(spec, config.camera, path)
    roots = [_root(part.parent) for part in (left, right, camera)]
    if not roots[0].name == roots[1].name == roots[2].name:
        raise RobotError(
            f"Wheels and camera of {path} hang on different bodies of the world ({', '.join(r.name for r in roots)}); "
            "a robot is one body with everything on it."
        )
    free = next((joint for joint in roots[0].joints if joint.type == mujoco.mjtJoint.mjJNT_FREE), None)
    if free is None:
        # Slide joints and a hinge that move a base over the floor have the role of the free joint.
        others = {joint.name: joint for joint in roots[0].joints}
        for actuator in [actuator for actuator in spec.actuators if actuator.target in others]:
            spec.delete(actuator)
        for joint in others.values():
            spec.delete(joint)
        free = roots[0].add_freejoint()
    if not free.name:
        free.name = unused_name("base", spec.joint)
    return RobotParts(roots[0].name, free.name, (left.name, right.name), camera.name)


def isolate_robot(spec: mujoco.MjSpec, parts: RobotParts) -> None:
    """Remove the world around the robot, lights, keyframes and global settings; hide the robot from its own camera."""
    world = spec.worldbody
    for element in [*world.geoms, *world.sites, *world.lights, *world.cameras]:
        spec.delete(element)
    for body in [body for body in world.bodies if body.name != parts.root]:
        spec.delete(body)
    for element in [*spec.lights, *spec.keys]:
        spec.delete(element)
    # The scene sets time step, gravity and light.
    spec.option, spec.visual, spec.stat = (empty := mujoco.MjSpec()).option, empty.visual, empty.stat
    _name_all(spec.geoms, "geom")
    _name_all(spec.actuators, "actuator")
    for geom in spec.geoms:
        if geom.group in (0, 2):
            geom.group = ROBOT_GROUP


def unused_name(wanted: str, find: Callable[[str], Any]) -> str:
    """The wanted name, extended until ``find`` (such as ``spec.geom``) does not know it."""
    while find(wanted) is not None:
        wanted += "_"
    return wanted


def _name_all(elements: Iterable[Any], kind: str) -> None:
    """Name all unnamed elements; later look-ups go by name."""
    elements = list(elements)
    taken = {element.name for element in elements}
    for number, element in enumerate(elements):
        if not element.name:
            element.name = next(name for k in range(len(taken) + 1) if (name := f"{kind}_{number + k}") not in taken)
            taken.add(element.name)


def _wheel(spec: mujoco.MjSpec, given: str, usual: tuple[str, ...], side: str, path: Path) -> mujoco._specs.MjsJoint:
    joints = {joint.name: joint for joint in spec.joints}
    found = next((joints[name] for name in ((given,) if given else usual) if name in joints), None)
    hinges = ", ".join(n for n, j in joints.items() if n and j.type == mujoco.mjtJoint.mjJNT_HINGE) or "none"
    if found is None:
        what = f'hinge "{given}"' if given else f"{side} wheel (a hinge named {', '.join(usual[:2])} or alike)"
        raise RobotError(
            f"The robot {path} has no {what}; its hinges are {hinges}: name one by --set model.{side}_wheel=NAME."
        )
    if found.type != mujoco.mjtJoint.mjJNT_HINGE:
        raise RobotError(f'The joint "{found.name}" of {path} is no hinge; a wheel turns about one. Hinges: {hinges}.')
    return found


def _camera(spec: mujoco.MjSpec, given: str, path: Path) -> mujoco._specs.MjsCamera:
    cameras = {camera.name: camera for camera in spec.cameras if camera.name}
    if given or CAMERA in cameras:
        found = cameras.get(given or CAMERA)
    else:
        found = next(iter(cameras.values())) if len(cameras) == 1 else None
    if found is None:
        known = ", ".join(cameras) or "none"
        what = f'camera "{given}"' if given else f'camera named "{CAMERA}"'
        raise RobotError(
            f"The robot {path} has no {what}; its cameras are {known}: name one by --set model.camera=NAME, or add one."
        )
    return found


def _root(body: mujoco._specs.MjsBody) -> mujoco._specs.MjsBody:
    """The top-level ancestor of a body."""
    while body.parent is not None and body.parent.name != "world":
        body = body.parent
    return body
