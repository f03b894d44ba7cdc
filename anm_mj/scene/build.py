"""Puts a scene and a robot together into one MuJoCo model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from anm_mj.errors import RobotError, SceneError
from anm_mj.scene.chunks import MIN_TRIANGLES, cut_into_chunks
from anm_mj.scene.folder import Scene
from anm_mj.scene.model_cache import cached_model

if TYPE_CHECKING:
    import mujoco


def build_spec(scene: Scene, robot_xml: Path | None, prefix: str = "robot/") -> mujoco.MjSpec:
    """The scene with the robot attached at the world's origin, not yet compiled.

    Every element of the robot gets ``prefix`` before its name. Its root body's joint (a free joint, or planar ones) is
    taken as it is.

    Raises:
        SceneError: if scene.xml cannot be read.
        RobotError: if the robot's MJCF cannot be read or attached.
    """
    import mujoco

    try:
        spec = mujoco.MjSpec.from_file(str(scene.xml))
        if scene.num_triangles >= MIN_TRIANGLES:
            cut_into_chunks(spec)
    except (ValueError, OSError) as err:
        raise SceneError(f"{scene.xml} cannot be read ({err}): import the scene again.") from err
    if robot_xml is not None:
        try:
            robot = mujoco.MjSpec.from_file(str(robot_xml))
            spec.attach(robot, prefix=prefix, frame=spec.worldbody.add_frame())
        except (ValueError, OSError) as err:
            raise RobotError(f"Robot {robot_xml} cannot be used ({err}): give an MJCF file with one robot.") from err
    return spec


def build_model(scene: Scene, robot_xml: Path | None, prefix: str = "robot/") -> mujoco.MjModel:
    """The compiled model of a scene and, if given, a robot attached at the world's origin.

    Models of large scenes are kept in the user's cache folder (:mod:`anm_mj.scene.model_cache`).

    Raises:
        SceneError: if the scene cannot be read or compiled.
        RobotError: if the robot's MJCF cannot be read or attached.
    """

    def compile_model() -> mujoco.MjModel:
        spec = build_spec(scene, robot_xml, prefix)
        try:
            return spec.compile()
        except ValueError as err:
            raise SceneError(f"Scene {scene.name} cannot be compiled ({err}): import it again.") from err

    return cached_model(scene, robot_xml, prefix, compile_model)
