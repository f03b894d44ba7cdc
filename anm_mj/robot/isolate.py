"""Leaves of a robot's spec what drives: locks joints at given positions, and removes everything around the robot."""

import mujoco
import numpy as np

from anm_mj.mjcf.poses import body_pose, set_pose
from anm_mj.mjcf.read_mjcf import compile_spec
from anm_mj.robot.compiled_robot import joints_above, name_all

ROBOT_GROUP = 1
"""Group of the robot's geoms: visible in viewers, hidden from the robot's own camera."""

_SIZES = ("memory", "njmax", "nconmax", "nkey", "nuserdata", "nuser_body", "nuser_jnt", "nuser_geom", "nuser_site")
_SIZES += ("nuser_cam", "nuser_tendon", "nuser_actuator", "nuser_sensor")
"""What an MJCF file's <size> asks room for, by the names of its spec."""


def keep_masses(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Write into the elements of a spec, which is changed in place, what its ``<compiler>`` makes of their masses: in a
    scene, and once geoms have another group, it would make something else. ``model`` is compiled from the spec.
    """
    if spec.compiler.settotalmass > 0.0:
        spec.compiler.settotalmass = -1.0
        scale = float(model.body_mass.sum()) / max(float(compile_spec(spec).body_mass.sum()), 1e-9)
        for geom in spec.geoms:
            geom.mass, geom.density = geom.mass * scale, geom.density * scale
        for body in spec.bodies:
            body.mass, body.inertia, body.fullinertia = (
                scale * value for value in (body.mass, body.inertia, body.fullinertia)
            )
        # Bounds come before the total.
        spec.compiler.boundmass *= scale
        spec.compiler.boundinertia *= scale
    first, last = spec.compiler.inertiagrouprange
    for geom in [geom for geom in spec.geoms if not first <= geom.group <= last]:
        geom.mass = 0.0
    spec.compiler.inertiagrouprange = [0, mujoco.mjNGROUP - 1]


def lock_joints(
    spec: mujoco.MjSpec, model: mujoco.MjModel, data: mujoco.MjData, keep: set[str], root: str
) -> list[str]:
    """Weld all bodies of a robot to their parents where they are, but for the joints in ``keep``; names of the others.

    Joints of ``root``, its top-level body, stay as well. Actuators and sensors of the locked joints disappear, with all
    tendons and equalities, which would hold the wheels; gravity acts on all bodies again. All joints of the spec, which
    is changed in place, are named.
    """
    root_id = model.body(root).id
    locked = [
        j
        for j in range(model.njnt)
        if model.body_rootid[model.jnt_bodyid[j]] == root_id
        and model.jnt_bodyid[j] != root_id
        and model.joint(j).name not in keep
    ]
    if not locked:
        _uncouple(spec)
        return []
    names = [model.joint(j).name for j in locked]
    for body_id in sorted({int(model.jnt_bodyid[j]) for j in locked}):
        parent = int(model.body_parentid[body_id])
        body = spec.body(model.body(body_id).name)
        set_pose(body, np.linalg.inv(body_pose(data, parent)) @ body_pose(data, body_id))
    for element in [*spec.sensors, *spec.keys]:
        spec.delete(element)
    kinds = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    for actuator in [a for a in spec.actuators if a.trntype not in kinds or a.target in names]:
        spec.delete(actuator)
    _uncouple(spec)
    for name in names:
        spec.delete(spec.joint(name))
    return names


def _uncouple(spec: mujoco.MjSpec) -> None:
    """Remove what couples the wheels to each other or carries the robot: equalities, tendons, gravity compensation."""
    tendons = list(spec.tendons)
    if tendons:
        remove_actuators(spec, [a for a in spec.actuators if a.trntype == mujoco.mjtTrn.mjTRN_TENDON])
        for sensor in [s for s in spec.sensors if s.objtype == mujoco.mjtObj.mjOBJ_TENDON]:
            spec.delete(sensor)
    # What bends hangs on equalities, and belongs to no body that drives.
    for element in [*spec.equalities, *tendons, *spec.flexes, *spec.skins]:
        spec.delete(element)
    for body in spec.bodies:
        body.gravcomp = 0.0


def hangs_on_joint(model: mujoco.MjModel, body: int, kept: set[str]) -> bool:
    """Whether one of the kept joints lies between a body and the world, the root's own not counted."""
    return any(
        model.joint(j).name in kept and model.jnt_bodyid[j] != model.body_rootid[body]
        for j in joints_above(model, body)
    )


def _names(spec: mujoco.MjSpec) -> set[str]:
    return {element.name for element in (*spec.bodies, *spec.geoms, *spec.sites, *spec.cameras)}


def isolate_robot(spec: mujoco.MjSpec, root: str) -> None:
    """Remove the world around the robot, with what is said of contacts with it and sensors of it, lights, skies, key
    frames, tuples and global settings; hide the robot from its own camera.
    """
    world = spec.worldbody
    before = _names(spec)
    for element in [*world.geoms, *world.sites, *world.lights, *world.cameras]:
        spec.delete(element)
    for body in [body for body in world.bodies if body.name != root]:
        spec.delete(body)
    gone = before - _names(spec) | {"world"}
    pairs = [one for one in spec.pairs if gone & {one.geomname1, one.geomname2}]
    excludes = [one for one in spec.excludes if gone & {one.bodyname1, one.bodyname2}]
    sensors = [one for one in spec.sensors if gone & {one.objname, one.refname}]
    for element in [*pairs, *excludes, *sensors, *spec.lights, *spec.keys, *spec.tuples]:
        spec.delete(element)
    for texture in [t for t in spec.textures if t.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX]:
        spec.delete(texture)
    # The scene sets time step, gravity and light, and has room of its own.
    spec.option, spec.visual, spec.stat = (empty := mujoco.MjSpec()).option, empty.visual, empty.stat
    for name in _SIZES:
        setattr(spec, name, getattr(empty, name))
    name_all(spec.geoms, "geom")
    name_all(spec.actuators, "actuator")
    for geom in spec.geoms:
        if geom.group in (0, 2):
            geom.group = ROBOT_GROUP
        if (geom.contype or geom.conaffinity) and not (geom.contype & 1 or geom.conaffinity & 1):
            # Scenes collide by the first bit; a robot of other bits would fall through the floor.
            geom.contype = geom.conaffinity = 1


def give_free_joint(spec: mujoco.MjSpec, root: str, name: str) -> str:
    """Name of the root's free joint; one that is added, by this ``name``, replaces all other joints of the root with
    their actuators.
    """
    body = spec.body(root)
    free = next((joint for joint in body.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE), None)
    if free is None:
        remove_joints(spec, {joint.name for joint in body.joints})
        free = body.add_freejoint()
        free.name = name
    return free.name


def remove_joints(spec: mujoco.MjSpec, names: set[str]) -> None:
    """Remove joints, with the actuators and sensors on them."""
    remove_actuators(spec, [a for a in spec.actuators if a.target in names])
    joints = [joint for joint in spec.joints if joint.name in names]
    for element in [*[s for s in spec.sensors if s.objname in names], *joints]:
        spec.delete(element)


def remove_actuators(spec: mujoco.MjSpec, actuators: list["mujoco._specs.MjsActuator"]) -> None:
    """Remove actuators, with the sensors of what they do."""
    names = {actuator.name for actuator in actuators}
    sensors = [s for s in spec.sensors if s.objtype == mujoco.mjtObj.mjOBJ_ACTUATOR and s.objname in names]
    for element in [*actuators, *sensors]:
        spec.delete(element)
