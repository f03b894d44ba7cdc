"""Makes the robot that a run drives: the one place that knows scene, simulator and drives.

mujoco is imported when a robot is made and not before, because by then its GL back-end must have been chosen.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from anm_mj.config import DRIVES
from anm_mj.errors import RobotError, SceneError
from anm_mj.scene.navigable import require_clear
from anm_mj.sim.gl import require_unforked, select_backend
from anm_mj.types import Footprint, Pose2

if TYPE_CHECKING:
    from anm_mj.scene.folder import Scene
    from anm_mj.sim.robot import SimRobot

ROBOT_XML = Path(__file__).resolve().parents[1] / "models" / "diff_drive" / "diff_drive.xml"
FOOTPRINT = Footprint(radius_m=0.18, z_min_m=0.05, z_max_m=1.35)
"""Of the robot in ``models/diff_drive``: its shell has a radius of 0.17 m and begins 0.05 m above the floor."""
_PREFIX = "robot/"


def make_robot(scene: Scene, *, start: Pose2 | None = None, drive: str = "kinematic", image_px: int = 256) -> SimRobot:
    """A simulated robot in a scene, standing at its start.

    Args:
        scene: the world.
        start: where the robot stands first; the scene's first start pose when None.
        drive: one of ``DRIVES``.
        image_px: width and height of the camera's pictures [px].

    Returns:
        The robot; close it when done.

    Raises:
        SceneError: if the scene cannot be built, or the start pose is outside it or touches something.
        RobotError: if there is no such drive.
        RenderError: if no GL back-end works.
    """
    if drive not in DRIVES:
        raise RobotError(f'There is no drive "{drive}"; choose one of {", ".join(DRIVES)}.')
    if image_px < 1:
        raise RobotError(f"A camera of {image_px} x {image_px} px sees nothing; image_px must be positive, e.g. 256.")
    select_backend()
    require_unforked()
    import mujoco

    from anm_mj.control.clearance import Clearance
    from anm_mj.control.kinematic_drive import KinematicDrive
    from anm_mj.control.physics_drive import PhysicsDrive
    from anm_mj.control.robot_model import CAMERA, RobotModel
    from anm_mj.scene.build import build_model
    from anm_mj.sim.camera import RgbdCamera
    from anm_mj.sim.robot import SimRobot

    clearance = Clearance(*scene.triangles(), FOOTPRINT)
    start = _start_pose(scene, start)
    model = build_model(scene, ROBOT_XML, _PREFIX)
    data = mujoco.MjData(model)
    robot_model = RobotModel(ROBOT_XML)
    if drive == "kinematic":
        wheels = KinematicDrive(model, data, robot_model, clearance, prefix=_PREFIX)
    else:
        wheels = PhysicsDrive(model, data, ROBOT_XML, robot_model, prefix=_PREFIX)
    wheels.place(start)
    camera = RgbdCamera(model, _PREFIX + CAMERA, image_px, image_px, cull_face=scene.cull_face)
    return SimRobot(model, data, camera, wheels, FOOTPRINT)


def _start_pose(scene: Scene, start: Pose2 | None) -> Pose2:
    """The start that was asked for, or the scene's first.

    Raises:
        SceneError: if it is no place to stand.
    """
    if start is None:
        if not scene.starts:
            raise SceneError(f"Scene {scene.name} names no start pose; give one (x, y, yaw).")
        start = scene.starts[0]
    where = f"({start.x_m:g} m, {start.y_m:g} m, {math.degrees(start.yaw_rad):g} deg)"
    low, high = scene.bounds_m[:, :2]
    if not (low <= start.xy_m).all() or not (start.xy_m <= high).all():
        raise SceneError(
            f"The start pose {where} lies outside scene {scene.name}, which reaches from ({low[0]:g} m, {low[1]:g} m) "
            f"to ({high[0]:g} m, {high[1]:g} m); choose one within{_clear_starts(scene)}."
        )
    require_clear(scene, start, FOOTPRINT)
    return start


def _clear_starts(scene: Scene) -> str:
    """Start poses known to be clear, as the end of an error message."""
    known = ", ".join(f"({p.x_m:g}, {p.y_m:g}, {math.degrees(p.yaw_rad):g})" for p in scene.starts[:3])
    return f", for example {known} (m, m, deg)" if known else ""
