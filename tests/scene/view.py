"""What a camera sees of a scene's visual meshes."""

import numpy as np

from anm_mj.scene.build import build_spec
from anm_mj.scene.folder import Scene


def look(
    scene: Scene, eye: tuple[float, float, float], right: tuple[float, float, float], *, depth: bool = False
) -> np.ndarray:
    """A picture of 65 x 65 pixels and 90 degrees from ``eye``, level, with world direction ``right`` to the right.

    Colours, or planar depth [m] if asked.
    """
    import mujoco

    up = np.array([0.0, 0.0, 1.0])
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.stack([right, up, np.cross(right, up)], axis=1).ravel())
    spec = build_spec(scene)
    spec.worldbody.add_camera(name="eye", pos=eye, quat=quat, fovy=90.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    option = mujoco.MjvOption()
    option.geomgroup[:] = [group == 2 for group in range(mujoco.mjNGROUP)]
    with mujoco.Renderer(model, 65, 65) as renderer:
        if depth:
            renderer.enable_depth_rendering()
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_SKYBOX, mujoco.mjtRndFlag.mjRND_CULL_FACE):
            renderer.scene.flags[flag] = 0
        renderer.update_scene(data, "eye", option)
        return renderer.render().copy()


def is_shade_of(seen: np.ndarray, colour: tuple[int, int, int]) -> bool:
    """Whether a pixel has a colour as :mod:`anm_mj.scene.importing.shading` darkens it."""
    share = float(seen.max()) / max(colour)
    return 0.55 <= share <= 1.01 and bool(np.abs(seen - share * np.array(colour)).max() <= 2.0)
