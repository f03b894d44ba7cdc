"""Observations of a finished run, taken once more from where its camera stood: for measuring maps on equal input."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from anm_mj.errors import RunFolderError
from anm_mj.io.read_run import Run
from anm_mj.scene.folder import Scene, load_scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.types import Observation, Pose2

ROBOT_PREFIX = "robot/"
"""What the names of the robot's joints begin with in a scene."""


def explored_scene(record: Run, scene: str | None = None) -> Scene:
    """The scene that a run explored.

    Args:
        record: The run.
        scene: Its name or folder now, if it has moved since.

    Raises:
        SceneError: There is no such scene.
        RunFolderError: It is not the one that the run explored.
    """
    world = load_scene(scene or record.manifest["scene"])
    if world.hash != record.manifest["scene_hash"]:
        raise RunFolderError(
            f"{record.folder.path} explored another scene than {world.folder}; give the right one by --scene."
        )
    return world


def observe_at(world: Scene, poses: list[Pose2], image_px: int) -> Iterator[Observation]:
    """What the simulated robot sees from each of the poses; nothing is asked about obstacles.

    Args:
        world: The scene.
        poses: Where the robot stands, in this order; their place in it is the observation's step.
        image_px: Width and height of the pictures [px].

    Raises:
        RenderError: If no GL back-end works.
    """
    with make_robot(world, image_px=image_px) as robot:
        # Imports mujoco, which it may do only once the robot's maker has chosen a GL back-end.
        from anm_mj.control.simulated_base import SimulatedBase

        base = SimulatedBase(robot.model, robot.data, ROBOT_PREFIX)
        for step, pose in enumerate(poses):
            base.place(pose)
            yield replace(robot.observe(), step=step)


def observations_of(record: Run, world: Scene) -> Iterator[Observation]:
    """All observations of a run with exact drives, in their order: the same pictures as then.

    Raises:
        RenderError: If no GL back-end works.
    """
    return observe_at(world, [frame.pose for frame in record.frames], record.intrinsics.width)
