"""Measures both drives against their bounds and prints one line per figure.

    python scripts/bench_drive.py                          # exactness, cost, pushes
    python scripts/bench_drive.py --replay runs/latest     # the same actions in both drives: completion of each

Physics: a random drive through a scene; after each action, the true pose against the commanded one. Kinematic: the
same, with the scene's triangles subdivided to a million. Pushes: a force on the robot from many directions, next to
obstacles. Times are CPU times of the process.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from anm_mj.cli.command_line import run_script
from anm_mj.control.action_motion import action_motion
from anm_mj.evaluation.completion_curve import CompletionCurve
from anm_mj.frames import move_pose, wrap_angle
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.ground_truth.reduced_depth import reduce_depth
from anm_mj.io.read_run import read_run
from anm_mj.io.to_json import write_json
from anm_mj.scene.folder import Scene, load_scene
from anm_mj.scene.navigable import is_clear, scene_area
from anm_mj.sim.make_robot import make_robot
from anm_mj.sim.simulation_config import DRIVES
from anm_mj.types import Action, Footprint, Pose2

if TYPE_CHECKING:
    # Imports mujoco, which must wait for the selection of the GL back-end.
    from anm_mj.geometry.clearance import Clearance
    from anm_mj.sim.sim_robot import SimRobot

FREE_M = 0.12
"""The random drive turns away from obstacles closer ahead than this [m]."""
ROOM_M = 0.04
"""Extra distance to obstacles in the random drive with physics [m]."""
PUSH_S = 1.0
NEAR_M = 0.3
"""Largest distance to an obstacle at the start of a push [m]."""
CORE_M = 0.1
"""A triangle closer to the robot's axis has passed through its shell [m]."""


@dataclass(frozen=True)
class Figure:
    """A measured value and its upper bound."""

    name: str
    value: float
    bound: float
    unit: str


def main(
    scene: str = "home",
    actions: int = 1000,
    triangles: int = 1_000_000,
    pushes: int = 24,
    push_n: float = 30.0,
    replay: Path | None = None,
    out: Path | None = None,
) -> None:
    """Measure and print.

    Args:
        scene: name or folder.
        actions: number of random actions.
        triangles: least number of triangles for the kinematic drive.
        pushes: number of push directions.
        push_n: force of a push, held for a second [N]; the robot weighs 94 N.
        replay: run folder; instead of all other measurements, both drives repeat its actions.
        out: JSON file for the figures.
    """
    if replay is not None:
        figures = replay_figures(replay)
    else:
        world = load_scene(scene)
        figures = [*physics_figures(world, actions), *kinematic_figures(world, actions, triangles)]
        figures += push_figures(world, pushes, push_n)
    for figure in figures:
        verdict = "" if math.isinf(figure.bound) else "within" if figure.value <= figure.bound else "ABOVE"
        bound = "" if math.isinf(figure.bound) else f"  ({verdict} {figure.bound:g})"
        print(f"{figure.name:58} {figure.value:9.4f} {figure.unit}{bound}")
    if out is not None:
        write_json(out, figures)


def physics_figures(world: Scene, actions: int) -> list[Figure]:
    """Accuracy and CPU time per action of the physics drive."""
    worst_m = worst_rad = worst_forward_m = worst_turn_rad = worst_height_m = 0.0
    upright, cpu_ms, bumps = 1.0, [], 0
    with make_robot(world, drive="physics", image_px=16) as robot:
        from anm_mj.geometry.clearance import Clearance

        root, asked = robot.model.body("robot/base").id, robot.pose
        # Obstacle boxes are up to a cell thicker than the obstacles.
        wide = replace(robot.footprint, radius_m=robot.footprint.radius_m + ROOM_M)
        for action in mixed_actions(robot, Clearance(*world.obstacles(), wide), actions):
            before, start_s = robot.pose, time.process_time()
            result = robot.act(action)
            cpu_ms.append(1e3 * (time.process_time() - start_s))
            if result.collided:
                # After a collision the commanded pose is the true one.
                bumps, asked = bumps + 1, robot.pose
                continue
            forward_m, turn_rad = action_motion(action)
            asked, pose = move_pose(asked, forward_m, turn_rad), robot.pose
            moved_m, turned_rad = distance_m(before, pose), wrap_angle(pose.yaw_rad - before.yaw_rad)
            worst_m = max(worst_m, distance_m(asked, pose))
            worst_rad = max(worst_rad, abs(wrap_angle(asked.yaw_rad - pose.yaw_rad)))
            if forward_m:
                worst_forward_m = max(worst_forward_m, abs(moved_m - forward_m))
            else:
                worst_turn_rad = max(worst_turn_rad, abs(turned_rad - turn_rad))
            upright = min(upright, float(robot.data.body(root).xmat[8]))
            worst_height_m = max(worst_height_m, abs(float(robot.data.body(root).xpos[2])))
        last_rad = abs(wrap_angle(asked.yaw_rad - robot.pose.yaw_rad))
        drift = distance_m(robot.pose, asked), distance_m(robot.pose, robot.odometry)
    return [
        Figure(f"physics: off the asked pose after {actions} actions", 1e3 * drift[0], 2.0, "mm"),
        Figure("physics: most off the asked pose at any time", 1e3 * worst_m, 2.0, "mm"),
        Figure(f"physics: heading off the asked one after {actions} actions", math.degrees(last_rad), 0.2, "deg"),
        Figure("physics: heading most off the asked one", math.degrees(worst_rad), 0.2, "deg"),
        Figure("physics: most a forward action is off 65 mm", 1e3 * worst_forward_m, 1.0, "mm"),
        Figure("physics: most a turn is off 10 degrees", math.degrees(worst_turn_rad), 0.1, "deg"),
        Figure("physics: CPU per action, mean", float(np.mean(cpu_ms)), 15.0, "ms"),
        Figure("physics: CPU per action, median", float(np.median(cpu_ms)), 15.0, "ms"),
        Figure("physics: largest tilt", math.degrees(math.acos(min(upright, 1.0))), 1.0, "deg"),
        Figure("physics: base off the floor", 1e3 * worst_height_m, 2.0, "mm"),
        Figure("physics: moves stopped by obstacles", bumps, math.inf, ""),
        Figure(f"physics: wheel odometry off after {actions} actions", 1e3 * drift[1], math.inf, "mm"),
    ]


def kinematic_figures(world: Scene, actions: int, triangles: int) -> list[Figure]:
    """CPU time per action of the kinematic drive in a scene with many triangles."""
    cpu_ms, moves = [], 0
    with make_robot(world, image_px=16) as robot:
        from anm_mj.geometry.clearance import Clearance
        from anm_mj.robot.description import describe_robot
        from anm_mj.robot.robot_presets import robot_path
        from anm_mj.sim.drives.kinematic_drive import KinematicDrive

        mesh = trimesh.Trimesh(*world.triangles(), process=False)
        while len(mesh.faces) < triangles:
            mesh = mesh.subdivide()
        clearance = Clearance(mesh.vertices, mesh.faces, robot.footprint)
        description = describe_robot(robot_path("diff_drive"))
        drive = KinematicDrive(robot.model, robot.data, description, clearance, prefix="robot/")
        drive.place(world.starts[0])
        for action in mixed_actions(robot, clearance, actions):
            start_s = time.process_time()
            moves += not drive.act(action).collided
            cpu_ms.append(1e3 * (time.process_time() - start_s))
    return [
        Figure("kinematic: triangles", len(mesh.faces), math.inf, ""),
        Figure("kinematic: CPU per action, mean", float(np.mean(cpu_ms)), 0.2, "ms"),
        Figure("kinematic: CPU per action, slowest hundredth", float(np.percentile(cpu_ms, 99)), math.inf, "ms"),
        Figure("kinematic: actions executed", moves, math.inf, ""),
    ]


def push_figures(world: Scene, pushes: int, push_n: float) -> list[Figure]:
    """Penetration into obstacles and tilt of the robot under pushes."""
    rng = np.random.default_rng(1)
    upright, inside_m, entered, pushed = 1.0, 0.0, 0, 0
    with make_robot(world, drive="physics", image_px=16) as robot:
        import mujoco

        from anm_mj.geometry.clearance import Clearance

        footprint = robot.footprint
        core = Clearance(*world.obstacles(), Footprint(CORE_M, footprint.z_min_m, footprint.z_max_m))
        area, root = scene_area(world, footprint), robot.model.body("robot/base").id
        row, col = np.nonzero((area.component == 1) & (area.clearance_m < footprint.radius_m + NEAR_M))
        beside = area.grid.origin_xy_m + (np.stack([col, row], axis=1) + 0.5) * area.grid.resolution_m
        while pushed < pushes:
            x, y = beside[rng.integers(len(beside))].tolist()
            start, towards = Pose2(x, y, rng.uniform(-3.0, 3.0)), math.tau * pushed / pushes
            if not is_clear(world, start, footprint):
                continue
            pushed += 1
            robot.restart(start)
            for _ in range(round(PUSH_S / robot.model.opt.timestep)):
                robot.data.xfrc_applied[root, :2] = push_n * math.cos(towards), push_n * math.sin(towards)
                mujoco.mj_step(robot.model, robot.data)
                upright = min(upright, float(robot.data.body(root).xmat[8]))
                sideways = [contact.dist for contact in robot.data.contact if abs(contact.frame[2]) < 0.5]
                inside_m = max(inside_m, -min(sideways, default=0.0))
                entered += core.collides(robot.pose)
            robot.data.xfrc_applied[root] = 0.0
            for action in (Action.TURN_LEFT, Action.MOVE_FORWARD, Action.TURN_RIGHT):
                robot.act(action)
                entered += core.collides(robot.pose)
    tilt_deg = math.degrees(math.acos(min(upright, 1.0)))
    return [
        Figure(f"pushed {pushed} times with {push_n:g} N: largest tilt", tilt_deg, 15.0, "deg"),
        Figure("pushed: deepest into an obstacle box, for a moment", 1e3 * inside_m, 20.0, "mm"),
        Figure("pushed: times that a wall stood inside the robot", entered, 0.0, ""),
    ]


def replay_figures(run: Path) -> list[Figure]:
    """Completion after the actions of a finished run, for both drives."""
    record = read_run(run)
    world = load_scene(record.manifest["scene"])
    truth = GroundTruth.sample(*world.triangles())
    figures, ratios, ends = [], [], []
    for drive in DRIVES:
        curve, collisions = CompletionCurve(truth), 0
        with make_robot(world, start=record.frames[0].pose, drive=drive, image_px=record.intrinsics.width) as robot:
            for step in (None, *record.steps):
                collisions += step is not None and robot.act(Action[step.action]).collided
                seen = robot.observe()
                depth_mm = reduce_depth(seen.depth_m)
                curve.frame(seen.step, depth_mm, seen.intrinsics, seen.T_world_camera, seen.pose)
            ends.append(robot.pose)
        curve.last()
        ratios.append(curve.rows[-1].completion_ratio)
        figures.append(Figure(f"{drive}: completion after {len(record.steps)} actions", ratios[-1], math.inf, "%"))
        figures.append(Figure(f"{drive}: collisions", collisions, math.inf, ""))
    return [
        *figures,
        Figure("difference of completion", abs(ratios[0] - ratios[1]), 2.0, "points"),
        Figure("distance of the two ends", 1e3 * distance_m(*ends), math.inf, "mm"),
    ]


def mixed_actions(robot: SimRobot, clearance: Clearance, actions: int) -> Iterator[Action]:
    """Random forward moves and turns, with turns away from obstacles ahead."""
    rng = np.random.default_rng(0)
    turn = Action.TURN_LEFT
    for _ in range(actions):
        if clearance.sweep_collides(robot.pose, FREE_M):
            yield turn
            continue
        turn = Action(rng.choice([Action.TURN_LEFT, Action.TURN_RIGHT]))
        yield Action.MOVE_FORWARD if rng.random() < 0.6 else turn


def distance_m(a: Pose2, b: Pose2) -> float:
    """Distance between two positions [m]."""
    return math.hypot(a.x_m - b.x_m, a.y_m - b.y_m)


if __name__ == "__main__":
    run_script(main)
