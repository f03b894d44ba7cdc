"""Makes the simulated robot of a run out of scene, robot description, drive and camera.

This module imports mujoco inside ``make_robot`` only, after the selection of the GL back-end.
"""

from __future__ import annotations

import functools
import logging
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from anm_mj.errors import ConfigError, RobotError, SceneError
from anm_mj.people.people_config import PeopleConfig
from anm_mj.robot.robot_config import DEFAULT_ROBOT, CameraConfig, RobotConfig
from anm_mj.robot.robot_presets import preset_config, robot_path
from anm_mj.scene.navigable import is_clear, require_clear, scene_clearance
from anm_mj.sim.gl import select_backend
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.sim.simulation_config import IDEAL, SimulationConfig, in_reality
from anm_mj.types import Footprint, Pose2
from anm_mj.utils.memory import forget_content
from anm_mj.utils.threads import usual_num_threads

if TYPE_CHECKING:
    from anm_mj.scene.folder import Scene
    from anm_mj.sim.sim_robot import SimRobot

_logger = logging.getLogger(__name__)

_PREFIX = "robot/"
_ANY_THREAD = ("egl", "osmesa", "off")
"""GL back-ends that render in any thread, not only in the program's first."""

_KINDS: dict[str, type] = {
    "model": RobotConfig,
    "camera": CameraConfig,
    "sensor": SensorConfig,
    "people": PeopleConfig,
    "start": Pose2,
}
"""Of options."""


def make_robot(
    scene: Scene,
    config: SimulationConfig | None = None,
    *,
    start: Pose2 | None = None,
    must_fit: bool = True,
    knows_start: bool = True,
    anticipates: bool = False,
    forgets_textures: bool = False,
    **options: Any,
) -> SimRobot:
    """A simulated robot in a scene, at its start pose. Returns the robot; close it when done.

    Args:
        scene: the world.
        config: what the robot is made of; None = the defaults of the option ``reality``.
        start: start pose; None = the one of the configuration.
        must_fit: whether the robot must be clear of obstacles at its start.
        knows_start: as of :class:`~.sim_robot.SimRobot`.
        anticipates: whether it may move and render the next image while the present one is worked on, where there are
            cores for both; motions and images are the same.
        forgets_textures: whether the model gives its textures back once GL has them, so that they are held once; no
            other camera can render the model then.
        **options: fields of :class:`SimulationConfig` that take the place of those of ``config``, as in
            ``drive="physics"``; another ``robot`` comes with its own ``model``. A ``reality`` other than
            that of ``config`` is refused.

    Raises:
        ConfigError: if there is no such drive or pose source, a number is out of range, an option of another kind, or
            ``reality`` is another than that of ``config``.
        SceneError: if the scene cannot be built, or the start pose is outside of it or in collision.
        RobotError: if there is no such robot, the robot lacks a part, or the sensor's range exceeds the camera's far
            plane.
        RenderError: if the user's GL back-end does not work.
    """
    for name, value in {**options, "start": start}.items():
        kind = _KINDS.get(name, object)
        if not isinstance(value, kind | None):
            raise ConfigError(f"{name} is {value!r:.60}; give a {kind.__name__}.")
    if config is None:
        begins = in_reality(options.get("reality", IDEAL), options.get("robot", DEFAULT_ROBOT))
        config = SimulationConfig(str(scene.folder), **begins | options)
    elif options.get("reality", config.reality) != config.reality:
        raise ConfigError(
            f"reality is {options['reality']!r:.60}, but what it stands for is already in the configuration: give it "
            "without config, or in_reality(...) to SimulationConfig."
        )
    else:
        if (robot := options.get("robot", config.robot)) != config.robot:
            model = in_reality(config.reality, robot).get("model", preset_config(robot))
            options = {"model": model} | options
        config = replace(config, **options)
    path = robot_path(config.robot)
    backend = select_backend()
    import mujoco

    from anm_mj.localisation.odometry import odometer_of
    from anm_mj.people.crowd import Crowd
    from anm_mj.people.figures import Figures, add_figures
    from anm_mj.people.walking_floor import WalkingFloor
    from anm_mj.robot.kinematics import kinematics_of
    from anm_mj.scene.build import build_model
    from anm_mj.sim.camera_factory import make_camera
    from anm_mj.sim.describe_file import describe_file
    from anm_mj.sim.drives.kinematic_drive import KinematicDrive
    from anm_mj.sim.drives.physics_drive import PhysicsDrive
    from anm_mj.sim.drives.trail import Trail
    from anm_mj.sim.gl_camera import GlCamera
    from anm_mj.sim.sim_robot import SimRobot
    from anm_mj.sim.views_ahead import AheadCamera

    if idle := config.without_effect:
        _logger.warning(
            "%s: without effect on what is observed where sensor.depth is %s, sensor.odometry_slip_share %g, "
            "the pose is %s and so many move: %d.",
            ", ".join(idle),
            config.sensor.depth,
            config.sensor.odometry_slip_share,
            config.pose,
            config.people.num_bodies,
        )
    description = describe_file(path, config.model, config.camera, config.image_px)
    start = _start_pose(scene, start or config.start_pose, description.footprint, must_fit=must_fit)
    crowd, added, people, radius_m = None, "", config.people, description.footprint.radius_m
    if people.num_bodies:
        crowd = Crowd(people, WalkingFloor(scene), start.xy_m, radius_m, config.seed)
        leaves_m = crowd.doors.length_m.tolist()
        added = f":people {people.number} {people.vacuums} {people.has_chair:d} {leaves_m} {config.seed}"
    model = build_model(
        scene,
        description.spec,
        robot_name=description.name,
        robot_hash=description.hash,
        prefix=_PREFIX,
        top_m=description.footprint.z_max_m,
        add=None if crowd is None else functools.partial(add_figures, crowd=crowd, seed=config.seed),
        added=added,
    )
    if config.sensor.max_range_m > (far_m := model.vis.map.zfar * model.stat.extent):
        raise RobotError(
            f"sensor.max_range_m is {config.sensor.max_range_m:g} m, but the camera's far plane lies at {far_m:.3g} m; "
            "give a shorter range."
        )
    data = mujoco.MjData(model)
    odometer = odometer_of(kinematics_of(description), noise=config.model.wheel_noise, seed=config.seed)
    if config.drive == "kinematic":
        clearance = scene_clearance(scene, description.footprint)
        wheels = KinematicDrive(model, data, description, clearance, odometer=odometer, prefix=_PREFIX)
    else:
        wheels = PhysicsDrive(model, data, description, odometer=odometer, prefix=_PREFIX)
    wheels.place(start)
    if crowd is not None:
        wheels.move_among(crowd, Figures(model, crowd))
    if config.sensor.is_late:
        wheels.leave(Trail(model, config.sensor.delay_s + abs(config.sensor.stamp_error_s)))
    camera_name = _PREFIX + description.camera
    width, height = config.camera.image_size(config.image_px)
    make = functools.partial(make_camera, model, camera_name, width, height, cull_face=scene.cull_face, backend=backend)
    anticipates = anticipates and backend.name in _ANY_THREAD and usual_num_threads() > 1
    imager = AheadCamera(make) if anticipates else make()
    copied = None
    if anticipates and isinstance(wheels, PhysicsDrive):
        copied = PhysicsDrive(model, mujoco.MjData(model), description, prefix=_PREFIX)
    if forgets_textures and imager.kind == GlCamera.kind:
        forget_content(model.tex_data)
    T_base_camera = description.T_base_camera if config.pose != "true" else None
    return SimRobot(
        model,
        data,
        imager,
        wheels,
        description.footprint,
        T_base_camera,
        robot_hash=description.hash,
        sensor=config.sensor,
        seed=config.seed,
        knows_start=knows_start,
        copied=copied,
    )


def _start_pose(scene: Scene, start: Pose2 | None, footprint: Footprint, *, must_fit: bool) -> Pose2:
    """The given start, or the first one of the scene where the robot can stand; raises SceneError if it must be able
    to stand there, and is not.
    """
    if not must_fit:
        return start or next(iter(scene.starts), Pose2(0.0, 0.0, 0.0))
    if start is None:
        if not scene.starts:
            raise SceneError(f"Scene {scene.name} names no start pose; give one (x, y, yaw).")
        start = next((pose for pose in scene.starts if is_clear(scene, pose, footprint)), scene.starts[0])
    where = f"({start.x_m:g} m, {start.y_m:g} m, {math.degrees(start.yaw_rad):g} deg)"
    low, high = scene.bounds_m[:, :2]
    if not (low <= start.xy_m).all() or not (start.xy_m <= high).all():
        raise SceneError(
            f"The start pose {where} lies outside scene {scene.name}, which reaches from ({low[0]:g} m, {low[1]:g} m) "
            f"to ({high[0]:g} m, {high[1]:g} m); choose one within{_clear_starts(scene)}."
        )
    require_clear(scene, start, footprint)
    return start


def _clear_starts(scene: Scene) -> str:
    """Known start poses, as the end of an error message."""
    known = ", ".join(f"({p.x_m:g}, {p.y_m:g}, {math.degrees(p.yaw_rad):g})" for p in scene.starts[:3])
    return f", for example {known} (m, m, deg)" if known else ""
