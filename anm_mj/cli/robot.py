"""``anm-mj robot``: checks robots."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anm_mj.cli.command_line import Report
from anm_mj.cli.option_types import NewFile, Settings, require_ending, require_read

if TYPE_CHECKING:
    from anm_mj.robot.description import RobotDescription
    from anm_mj.sim.drives.drive_trial import DriveTrial

_CLOSE = 0.05
"""Share of a motion that may be missing, or that wheels may slip, without a remark."""


def robot_check(robot: str, *, settings: Settings = (), out: NewFile | None = None) -> Report:
    """Print what is understood of a robot, drive it, and draw it.

    The exit status is 1 where the robot does not drive.

    Args:
        robot: an MJCF file, or a name (docs/robot.md)
        settings: a setting of the robot, as in model.camera_pose=0.05,0,0.3,10,60; may be repeated
        out: picture; by default ROBOT_check.png in this folder
    """
    from anm_mj.cli.console import PlainConsole, say_problems
    from anm_mj.config import DEFAULT_PRESET, make_config
    from anm_mj.robot.robot_presets import robot_path
    from anm_mj.sim.gl import select_backend

    require_ending(out, (".png",))
    config = make_config(DEFAULT_PRESET, list(settings), scene="", robot=robot)
    require_read(settings, "model", "camera", "image_px")
    path = robot_path(robot)
    backend = select_backend()
    from anm_mj.mjcf.read_mjcf import root_tag
    from anm_mj.sim.describe_file import describe_file
    from anm_mj.sim.drives.drive_trial import drive_over_a_floor, plain_fault
    from anm_mj.sim.robot_views import robot_views
    from anm_mj.viz.robot_sheet import save_robot_sheet

    found = describe_file(path, config.model, config.camera, config.image_px)
    test = drive_over_a_floor(found)
    console = PlainConsole()
    # What MuJoCo alone makes of a URDF is not what runs here.
    plain = plain_fault(path, found.root) if root_tag(path) == "mujoco" else ""
    console.say(*describe(found, test), *([f"warning: {plain}"] if plain else []))
    images, width_m = robot_views(
        found.spec, found.root, found.T_root_base, found.T_base_camera, found.footprint, backend
    )
    out = out or Path(f"{found.name}_check.png")
    save_robot_sheet(out, images, width_m, found)
    console.say(f"picture: {out}")
    wrong = problems(found, test)
    facts = robot_facts(found) | {"drive": test, "problems": wrong, "picture": out}
    return Report(facts, say_problems(wrong))


def robot_facts(robot: RobotDescription) -> dict[str, Any]:
    """What ``--json`` says of a robot."""
    names = (
        "name kind mass_kg wheel_joints wheel_radius_m track_m track_scale max_wheel_radps footprint camera fovy_deg "
        "T_base_camera centre_of_mass_m locked key_frame notes"
    )
    return {name: getattr(robot, name) for name in names.split()}


def describe(robot: RobotDescription, test: DriveTrial) -> list[str]:
    """One line per thing that was understood."""
    x, y, z = robot.T_base_camera[:3, 3]
    ahead = robot.T_base_camera[:3, 2]
    tilt_deg, aside_deg = -math.degrees(math.asin(ahead[2])), math.degrees(math.atan2(ahead[1], ahead[0]))
    tilt = "level" if abs(tilt_deg) < 0.5 else f"{abs(tilt_deg):.0f} deg {'down' if tilt_deg > 0 else 'up'}"
    body = robot.footprint
    half = len(robot.wheel_joints) // 2
    lines = [f"{robot.name}: {robot.kind}, {robot.mass_kg:.1f} kg"]
    if half:
        lines += [
            f"wheels: left {', '.join(robot.wheel_joints[:half])}; right {', '.join(robot.wheel_joints[half:])}",
            f"wheel radius {robot.wheel_radius_m:.4f} m, track {robot.track_m:.4f} m"
            + (f", effective track {robot.track_m * robot.track_scale:.4f} m" if robot.track_scale != 1.0 else ""),
        ]
        if math.isfinite(robot.max_wheel_radps):
            lines.append(f"highest wheel speed {robot.max_wheel_radps:.3g} rad/s")
    else:
        lines.append("wheels: none, planar joints")
    lines += [
        f"footprint: circle of radius {body.radius_m:.3f} m about the base, heights {body.z_min_m:.2f} to "
        f"{body.z_max_m:.2f} m; it passes doors from {2.0 * body.radius_m:.2f} m on",
        f"camera: {robot.camera} at ({x:.3f}, {y:.3f}, {z:.3f}) m, {tilt}, {aside_deg:+.0f} deg to the "
        f"left, vertical field of view {robot.fovy_deg:.0f} deg",
        f"centre of mass: {robot.centre_of_mass_m[0]:+.3f} m ahead, {robot.centre_of_mass_m[2]:.3f} m up",
    ]
    if robot.locked:
        where = f"key frame {robot.key_frame}" if robot.key_frame else "their reference positions"
        lines.append(f"locked at {where}: {', '.join(robot.locked)}")
    lines += robot.notes
    lines.append(
        f"physics drive: {test.moved_m:.3f} of {test.asked_m:.3f} m forward, {math.degrees(test.turned_rad):.1f} of "
        f"{math.degrees(test.asked_rad):.0f} deg to the left"
    )
    slip = test.turn_by_wheels_rad / test.turned_rad if abs(test.turned_rad) > 0.1 else 1.0
    if abs(slip - 1.0) > _CLOSE and test.fault is None:
        lines.append(
            f"odometry: in turns the wheels roll {slip:.2f} times as far as without slip; --set "
            f"model.track_scale={slip * robot.track_scale:.2f} corrects that"
        )
    return lines


def problems(robot: RobotDescription, test: DriveTrial) -> list[str]:
    """Why the robot does not drive, with what to do; empty where it does."""
    found = []
    if len(robot.support_xy_m) and robot.wheel_joints:
        low, high = robot.support_xy_m[:, 0].min(), robot.support_xy_m[:, 0].max()
        if not low - 1e-6 <= robot.centre_of_mass_m[0] <= high + 1e-6:
            found.append(
                f"The centre of mass lies {robot.centre_of_mass_m[0]:+.3f} m ahead of the axle, but wheels and casters "
                f"only reach from {low:+.3f} to {high:+.3f} m, so that the robot tips over; add a caster."
            )
    if test.fault is not None:
        found.append(f"On an empty floor the physics drive ends with {test.fault}; see the lines above.")
    elif test.moved_m < (1.0 - _CLOSE) * test.asked_m or test.turned_rad < (1.0 - _CLOSE) * test.asked_rad:
        found.append("On an empty floor the physics drive falls short of what was asked; look at mass and friction.")
    return found
