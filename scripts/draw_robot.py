"""Renders a robot in a scene from the side: the figure in models/diff_drive/README.md.

python scripts/draw_robot.py --scene home --out models/diff_drive/robot.png
"""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from anm_mj.cli.command_line import run_script
from anm_mj.scene.folder import load_scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.types import Pose2

if TYPE_CHECKING:
    from anm_mj.sim.sim_robot import SimRobot

SEEN_GROUPS = (1, 2)
"""The robot's body and the scene's visible meshes."""


def main(
    out: Path,
    scene: str = "home",
    robot: str = "diff_drive",
    start: tuple[float, float, float] | None = None,
    azimuth_deg: float = 245.0,
    elevation_deg: float = -14.0,
    distance_m: float = 2.0,
    width: int = 640,
    height: int = 720,
) -> None:
    """Render and save an image.

    Args:
        out: PNG file.
        scene: name or folder.
        robot: name or MJCF file.
        start: x [m], y [m], yaw [deg]; the scene's first start by default.
        azimuth_deg: azimuth of the view, relative to the robot's heading.
        elevation_deg: elevation of the view.
        distance_m: distance to the centre of the robot.
        width: of the image [px].
        height: of the image [px].
    """
    pose = None if start is None else Pose2(start[0], start[1], math.radians(start[2]))
    with make_robot(load_scene(scene), start=pose, drive="physics", robot=robot, image_px=16) as placed:
        picture = view_from_beside(placed, azimuth_deg, elevation_deg, distance_m, width, height)
    Image.fromarray(picture).save(out)


def view_from_beside(
    robot: "SimRobot", azimuth_deg: float, elevation_deg: float, distance_m: float, width: int, height: int
) -> UInt8[np.ndarray, "h w 3"]:
    """Render the robot at its present pose."""
    import mujoco

    mujoco.mj_forward(robot.model, robot.data)
    robot.model.vis.global_.offwidth, robot.model.vis.global_.offheight = width, height
    # Textures light the scene; a single-coloured body needs a light for its shape to show.
    light = robot.model.vis.headlight
    light.ambient[:], light.diffuse[:] = 0.65, 0.45
    camera, option = mujoco.MjvCamera(), mujoco.MjvOption()
    pose, top_m = robot.pose, robot.footprint.z_max_m
    camera.lookat[:] = pose.x_m, pose.y_m, top_m / 2.0
    camera.distance, camera.elevation = distance_m, elevation_deg
    camera.azimuth = math.degrees(pose.yaw_rad) + azimuth_deg
    option.geomgroup[:] = [group in SEEN_GROUPS for group in range(mujoco.mjNGROUP)]
    with mujoco.Renderer(robot.model, height, width, max_geom=20_000) as renderer:
        renderer.update_scene(robot.data, camera, option)
        return renderer.render()


if __name__ == "__main__":
    run_script(main)
