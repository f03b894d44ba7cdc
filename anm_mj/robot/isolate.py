"""Removes everything around a robot from the spec of its file."""

import mujoco

from anm_mj.robot.body_tree import name_all

ROBOT_GROUP = 1
"""Group of the robot's geoms: visible in viewers, hidden from the robot's own camera."""


def isolate_robot(spec: mujoco.MjSpec, root: str) -> None:
    """Remove the world around the robot, lights, skies, key frames and global settings; hide it from its own camera."""
    world = spec.worldbody
    for element in [*world.geoms, *world.sites, *world.lights, *world.cameras]:
        spec.delete(element)
    for body in [body for body in world.bodies if body.name != root]:
        spec.delete(body)
    for element in [*spec.lights, *spec.keys]:
        spec.delete(element)
    for texture in [t for t in spec.textures if t.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX]:
        spec.delete(texture)
    # The scene sets time step, gravity and light.
    spec.option, spec.visual, spec.stat = (empty := mujoco.MjSpec()).option, empty.visual, empty.stat
    spec.njmax = spec.nconmax = -1
    name_all(spec.geoms, "geom")
    name_all(spec.actuators, "actuator")
    for geom in spec.geoms:
        if geom.group in (0, 2):
            geom.group = ROBOT_GROUP
        if (geom.contype or geom.conaffinity) and not (geom.contype & 1 or geom.conaffinity & 1):
            # Scenes collide by the first bit; a robot of other bits would fall through the floor.
            geom.contype = geom.conaffinity = 1


def give_free_joint(spec: mujoco.MjSpec, root: str, name: str) -> str:
    """Name of the root's free joint; one that is added replaces all other joints of the root with their actuators."""
    body = spec.body(root)
    free = next((joint for joint in body.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE), None)
    if free is None:
        remove_joints(spec, {joint.name for joint in body.joints})
        free = body.add_freejoint()
    if not free.name or free.name.startswith("joint_"):
        free.name = name
    return free.name


def remove_joints(spec: mujoco.MjSpec, names: set[str]) -> None:
    """Remove joints, with the actuators and sensors on them."""
    for element in [a for a in spec.actuators if a.target in names] + [s for s in spec.sensors if s.objname in names]:
        spec.delete(element)
    for joint in [joint for joint in spec.joints if joint.name in names]:
        spec.delete(joint)
