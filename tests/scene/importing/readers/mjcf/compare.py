"""Compares the depth of an imported scene with MuJoCo's own rendering of the file that it came from."""

import tomllib
from pathlib import Path

import numpy as np

from anm_mj.scene.folder import Scene

PX = 160


def depth_images(model, data, eyes, groups=(0, 1, 2)) -> np.ndarray:
    """Planar depth [m] from each eye (x, y, z, yaw): level, 90 degrees, 5 cm to 100 m; 0 where there is nothing."""
    import mujoco

    option = mujoco.MjvOption()
    option.geomgroup[:] = [group in groups for group in range(mujoco.mjNGROUP)]
    option.sitegroup[:] = 0
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
    images = []
    with mujoco.Renderer(model, PX, PX) as renderer:
        renderer.enable_depth_rendering()
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_SKYBOX, mujoco.mjtRndFlag.mjRND_CULL_FACE):
            renderer.scene.flags[flag] = 0
        for i in range(len(eyes)):
            camera.fixedcamid = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, f"eye_{i}")
            renderer.update_scene(data, camera, option)
            depth = renderer.render().astype(np.float64)
            images.append(np.where(depth > 99.0, 0.0, depth))
    return np.array(images)


def with_eyes(spec, eyes):
    """The spec compiled with a camera at each eye, in metres, and far planes that do not depend on the world."""
    import mujoco

    for i, (x, y, z, yaw) in enumerate(eyes):
        right, up = np.array([np.sin(yaw), -np.cos(yaw), 0.0]), np.array([0.0, 0.0, 1.0])
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, np.stack([right, up, np.cross(right, up)], axis=1).ravel())
        spec.worldbody.add_camera(name=f"eye_{i}", pos=(x, y, z), quat=quat, fovy=90.0)
    spec.stat.extent, spec.visual.map.znear, spec.visual.map.zfar = 1.0, 0.05, 100.0
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 640, 480
    return spec.compile()


def agreement(
    src: Path,
    scene: Scene,
    eyes,
    *,
    settle: bool = False,
    hidden: tuple[str, ...] = (),
    hide_robots: bool = False,
    least_seen: float = 0.5,
) -> float:
    """Share of pixels whose depth differs by less than 1 mm, over all eyes (x, y, z [m] in the scene, yaw).

    The source is rendered without the bodies of ``hidden`` and what hangs on them, with ``hide_robots`` also without
    what the import takes for robots. At least ``least_seen`` of the
    pixels must show something: a comparison of nothing with nothing says nothing.
    """
    import mujoco

    from anm_mj.scene.build import build_spec
    from anm_mj.scene.importing.readers.mjcf.bodies import robot_bodies
    from anm_mj.scene.importing.readers.mjcf.compile_world import initial_state

    entries = tomllib.loads((scene.folder / "scene.toml").read_text())
    dx, dy = entries.get("origin", (0.0, 0.0))
    there = [(x + dx, y + dy, z + entries["floor_removed"], yaw) for x, y, z, yaw in eyes]
    spec = mujoco.MjSpec.from_file(str(src))
    # A key frame fits no model with other bodies; cameras add none.
    source = with_eyes(spec, there)
    for name in hidden:
        root = source.body(name).id
        source.geom_group[source.body_rootid[source.geom_bodyid] == root] = 5
    state = initial_state(source, settle)
    for stage in (mujoco.mj_comPos, mujoco.mj_camlight, mujoco.mj_flex, mujoco.mj_tendon):
        stage(source, state)
    if hide_robots:
        source.geom_group[robot_bodies(source, state)[source.geom_bodyid]] = 5
    expected = depth_images(source, state, there)
    model = with_eyes(build_spec(scene), eyes)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    got = depth_images(model, data, eyes, groups=(0, 2))
    assert (expected > 0.0).mean() > least_seen
    return float((np.abs(expected - got) < 1e-3).mean())


def eyes_in(scene: Scene, number: int = 4, height_m: float = 1.25):
    """Places of the scene's starts, looking all around."""
    starts = scene.starts[:number]
    return [(s.x_m, s.y_m, height_m, s.yaw_rad + np.pi / 2 * k) for s in starts for k in range(4)]
