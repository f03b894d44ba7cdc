"""Program: renders a red box with the GL back-end in MUJOCO_GL and prints the name of the renderer.

It runs in a process of its own, because a broken back-end spoils the import of mujoco or kills the process. It imports
nothing of this package, so it starts as fast as mujoco does.
"""

import sys
from typing import Any

import mujoco
import numpy as np
from OpenGL import GL

_BOX_DISTANCE_M = 2.5
_RED_BOX = """
<mujoco>
  <statistic extent="1"/>
  <visual>
    <headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/>
    <map znear="0.01" zfar="100"/>
    <quality offsamples="0"/>
  </visual>
  <worldbody>
    <geom type="box" size="1 1 0.5" rgba="1 0 0 1"/>
    <camera name="camera" pos="0 0 3"/>
  </worldbody>
</mujoco>
"""


def main() -> None:
    """Write the GL_RENDERER string to standard output. Raises RuntimeError if colour or depth of the box is wrong."""
    model = mujoco.MjModel.from_xml_string(_RED_BOX)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, 32, 32) as renderer:
        renderer.update_scene(data, "camera")
        colour = renderer.render()[16, 16].copy()
        renderer.enable_depth_rendering()
        renderer.update_scene(data, "camera")
        depth_m = float(renderer.render()[16, 16])
        name: Any = GL.glGetString(GL.GL_RENDERER)
    if not np.array_equal(colour, [255, 0, 0]):
        raise RuntimeError(f"a red box was drawn in the colour {colour.tolist()}")
    if abs(depth_m - _BOX_DISTANCE_M) > 1e-3:
        raise RuntimeError(f"a box {_BOX_DISTANCE_M} m away was drawn at {depth_m:.3f} m")
    sys.stdout.write(name.decode())


if __name__ == "__main__":
    main()
