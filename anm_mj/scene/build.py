"""Builds the MuJoCo model of a scene and a robot."""

from collections.abc import Callable

import mujoco
import numpy as np

from anm_mj.errors import RobotError, SceneError
from anm_mj.mjcf.read_mjcf import compile_spec, read_spec
from anm_mj.scene.chunks import MIN_TRIANGLES, cut_into_chunks
from anm_mj.scene.collision import SLICE_Z_MAX_M, collision_boxes
from anm_mj.scene.folder import TOML, Scene
from anm_mj.scene.mjcf import BOX_TOP_M, COLLISION_GROUP, VISUAL_GROUP
from anm_mj.scene.model_cache import cached_model
from anm_mj.utils.memory import malloc_trim
from anm_mj.utils.read_file import read_bytes

_LIKE_M = 0.1
"""Robots that are lower than the boxes' slice by less than this meet the boxes of the scene's file [m]."""


def build_spec(scene: Scene) -> mujoco.MjSpec:
    """The uncompiled scene; large ones in chunks. Raises SceneError if scene.xml or a mesh cannot be read."""
    try:
        if b"<include" in read_bytes(scene.xml):
            raise ValueError("it includes other files")
        spec = read_spec(scene.xml, levels_up=0)
        if scene.num_triangles >= MIN_TRIANGLES:
            cut_into_chunks(spec)
    except (ValueError, OSError) as err:
        raise SceneError(f"{scene.xml} cannot be read ({err}): import the scene again.") from err
    return spec


def compile_scene(spec: mujoco.MjSpec, scene: Scene) -> mujoco.MjModel:
    """Compile the spec of a scene, including whatever was added to it. Raises SceneError if an asset is missing or
    damaged, or what is drawn is not what the scene states.
    """
    try:
        model = compile_spec(spec)
    except ValueError as err:
        raise SceneError(f"Scene {scene.name} cannot be compiled ({err}): import it again.") from err
    _require_drawn(model, scene)
    return model


def _require_drawn(model: mujoco.MjModel, scene: Scene, robot_prefix: str | None = None) -> None:
    """Raise unless a model draws every triangle of the scene: the camera would see another world than is measured."""
    drawn = sum(
        int(model.mesh_facenum[model.geom_dataid[geom]])
        for geom in np.flatnonzero((model.geom_group == VISUAL_GROUP) & (model.geom_dataid >= 0)).tolist()
        if robot_prefix is None or not model.body(int(model.geom_bodyid[geom])).name.startswith(robot_prefix)
    )
    if drawn != scene.num_triangles:
        raise SceneError(
            f"{scene.xml} draws {drawn:,} triangles, but {TOML} states {scene.num_triangles:,}: import the scene again."
        )


def build_model(
    scene: Scene,
    robot: mujoco.MjSpec | None = None,
    *,
    robot_name: str = "",
    robot_hash: str = "",
    prefix: str = "robot/",
    top_m: float | None = None,
    add: Callable[[mujoco.MjSpec], None] | None = None,
    added: str = "",
) -> mujoco.MjModel:
    """The compiled model of a scene, with a robot attached at the origin if one is given.

    A copy of ``robot`` (one root body with a free joint or planar joints) is attached, its names behind ``prefix``.
    ``robot_name`` stands in messages, ``robot_hash`` in the name under which the user's cache folder keeps the models
    of large scenes. The collision boxes are those that a robot ``top_m`` high meets [m]; None = those of the scene's
    file. ``add`` puts more into the scene, and ``added`` names all that it depends on. Raises SceneError if the scene
    cannot be read or compiled, and RobotError if the scene compiles alone, but not with the robot.
    """
    # Robots a little lower than the slice that the file's boxes cover meet the same.
    own_top_m = None if top_m is None or SLICE_Z_MAX_M - _LIKE_M <= top_m <= SLICE_Z_MAX_M else top_m

    def build() -> mujoco.MjModel:
        spec = build_spec(scene)
        if own_top_m is not None:
            _replace_boxes(spec, scene, own_top_m)
        if add is not None:
            add(spec)
        if robot is None:
            model = compile_scene(spec, scene)
        else:
            try:
                # Attaching hands the robot over to the spec; the copy leaves the caller the original.
                own = robot.copy()
                own.option = spec.option  # The scene's count; others would only cause a warning.
                spec.attach(own, prefix=prefix, frame=spec.worldbody.add_frame())
                model = compile_spec(spec)
            except ValueError as err:
                compile_scene(build_spec(scene), scene)
                raise RobotError(f"Robot {robot_name} cannot be put into scene {scene.name}: {err}.") from err
            _require_drawn(model, scene, prefix)
        # MuJoCo caches every decoded texture for another compilation, which does not come.
        mujoco.mj_clearCache(mujoco.mj_getCache())
        malloc_trim()
        return model

    made_of = robot_hash if own_top_m is None else f"{robot_hash}:{own_top_m:.3f}"
    return cached_model(scene, made_of + added, prefix, build)


def _replace_boxes(spec: mujoco.MjSpec, scene: Scene, top_m: float) -> None:
    """Replace the collision boxes of a scene's spec by those that cover its obstacles up to a height [m].

    Scenes with movable objects keep theirs: the stored triangles do not say which of them move.
    """
    if spec.worldbody.bodies:
        return
    for geom in [g for g in spec.worldbody.geoms if g.group == COLLISION_GROUP and g.type == mujoco.mjtGeom.mjGEOM_BOX]:
        spec.delete(geom)
    vertices, faces = scene.obstacles()
    above_m = BOX_TOP_M - SLICE_Z_MAX_M
    height_m = (top_m + above_m) / 2.0
    for i, (x_min, y_min, x_max, y_max) in enumerate(collision_boxes(vertices[faces], top_m)):
        spec.worldbody.add_geom(
            name=f"box_{i}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[(x_min + x_max) / 2.0, (y_min + y_max) / 2.0, height_m],
            size=[(x_max - x_min) / 2.0, (y_max - y_min) / 2.0, height_m],
            group=COLLISION_GROUP,
            rgba=[0.9, 0.4, 0.2, 0.4],
        )
