"""Puts a scene and a robot together into one MuJoCo model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from anm_mj.errors import RobotError, SceneError
from anm_mj.scene.chunks import MIN_TRIANGLES, cut_into_chunks
from anm_mj.scene.folder import Scene
from anm_mj.scene.model_cache import cached_model
from anm_mj.utils.memory import malloc_trim

if TYPE_CHECKING:
    import mujoco


def build_spec(scene: Scene) -> mujoco.MjSpec:
    """The scene, not yet compiled; the meshes of large scenes are cut into pieces.

    Raises:
        SceneError: if scene.xml, or a mesh to be cut, cannot be read.
    """
    import mujoco

    try:
        spec = mujoco.MjSpec.from_file(str(scene.xml))
        if scene.num_triangles >= MIN_TRIANGLES:
            cut_into_chunks(spec)
    except (ValueError, OSError) as err:
        raise SceneError(f"{scene.xml} cannot be read ({err}): import the scene again.") from err
    return spec


def compile_scene(spec: mujoco.MjSpec, scene: Scene) -> mujoco.MjModel:
    """The compiled model of a scene's spec, with whatever has been added to it.

    Raises:
        SceneError: if an asset is missing or damaged.
    """
    try:
        return spec.compile()
    except ValueError as err:
        raise SceneError(f"Scene {scene.name} cannot be compiled ({err}): import it again.") from err


def build_model(
    scene: Scene,
    robot: mujoco.MjSpec | None = None,
    *,
    robot_name: str = "",
    robot_hash: str = "",
    prefix: str = "robot/",
) -> mujoco.MjModel:
    """The compiled model of a scene and, if given, a robot attached at the world's origin.

    Models of large scenes are kept in the user's cache folder (:mod:`anm_mj.scene.model_cache`).

    Args:
        scene: the world.
        robot: one root body; its joint (a free joint, or planar ones) is taken as it is. It is copied.
        robot_name: what messages call it.
        robot_hash: says which robot it is; two robots with one hash are taken for the same.
        prefix: comes before the name of every element of the robot.

    Raises:
        SceneError: if the scene cannot be read or compiled.
        RobotError: if the scene can be compiled alone, but not with the robot.
    """

    def compiled() -> mujoco.MjModel:
        spec = build_spec(scene)
        if robot is None:
            return compile_scene(spec, scene)
        try:
            # MjSpec takes what is attached for its own, so the caller keeps the original.
            spec.attach(robot.copy(), prefix=prefix, frame=spec.worldbody.add_frame())
            return spec.compile()
        except ValueError as err:
            compile_scene(build_spec(scene), scene)
            raise RobotError(f"Robot {robot_name} cannot be put into scene {scene.name}: {err}.") from err

    def build() -> mujoco.MjModel:
        import mujoco

        model = compiled()
        # MuJoCo keeps every decoded texture for the next compilation of the same scene, of which there is none.
        mujoco.mj_clearCache(mujoco.mj_getCache())
        malloc_trim()
        return model

    return cached_model(scene, robot_hash, prefix, build)
