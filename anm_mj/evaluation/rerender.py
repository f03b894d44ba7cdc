"""Renders the simulator's view at given poses of a scene, such as those of a finished run, outside of any run."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, replace
from typing import Any, TypeVar

from anm_mj.errors import RunFolderError
from anm_mj.io.read_run import Run
from anm_mj.robot.robot_config import CameraConfig, RobotConfig
from anm_mj.robot.robot_presets import preset_config
from anm_mj.scene.folder import Scene, load_scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.sim.simulation_config import SimulationConfig
from anm_mj.types import Observation, Pose2
from anm_mj.utils.settings import of_type

T = TypeVar("T", CameraConfig, RobotConfig)


def explored_scene(record: Run, scene: str | None = None) -> Scene:
    """The scene that a run explored. ``scene`` is its present name or folder, if it has moved. Raises SceneError if
    there is no such scene, and RunFolderError if the run explored another scene.
    """
    if not {"scene", "scene_hash"} <= record.manifest.keys():
        raise RunFolderError(f"The manifest of {record.folder.path} names no scene; give the folder of a whole run.")
    world = load_scene(scene or record.manifest["scene"])
    if world.hash != record.manifest["scene_hash"]:
        raise RunFolderError(
            f"{record.folder.path} explored another scene than {world.folder}; give the right one by --scene."
        )
    return world


def observe_at(world: Scene, poses: Iterable[Pose2], image_px: int, record: Run | None = None) -> Iterator[Observation]:
    """The simulated robot's view at each pose, obstacles or not, with that pose and its index as the step.

    Poses are read one at a time. Robot and camera are those of a run, None for the builtin ones with images of
    ``image_px`` in width and height [px]. Raises RenderError if no GL back-end works, and RobotError if the robot's
    file has gone.
    """
    config: Mapping[str, Any] = {} if record is None else record.config
    camera = _of_config(CameraConfig, config.get("camera", {}))
    if record is not None:
        camera = replace(camera, width_px=record.intrinsics.width, height_px=record.intrinsics.height)
    name = config.get("robot", SimulationConfig.robot)
    model = _of_config(RobotConfig, config["model"]) if "model" in config else preset_config(name)
    # No odometry is read, and settings without effect would be told.
    model = replace(model, wheel_noise=0.0)
    options = {"image_px": image_px, "robot": name, "model": model, "camera": camera}
    # It is carried to each pose, and need not fit where runs in the scene begin.
    with make_robot(world, must_fit=False, **options) as robot:
        for step, pose in enumerate(poses):
            robot.place(pose)
            yield replace(robot.observe(), step=step, pose=pose)


def _of_config(kind: type[T], values: Mapping[str, Any]) -> T:
    """A group of settings of a run's configuration; what this version does not know is left out."""
    known = {entry.name for entry in fields(kind)}
    try:
        return kind(**{name: of_type(kind, name, value) for name, value in values.items() if name in known})
    except ValueError as err:
        raise RunFolderError(f"The run's config.json is damaged ({err}); copy the run again.") from err


def observations_of(record: Run, world: Scene) -> Iterator[Observation]:
    """All observations of a run, in order: the same images as in a run with an exact drive, true poses and no sensor.
    Raises RenderError if no GL back-end works.
    """
    return observe_at(world, [frame.pose for frame in record.frames], record.intrinsics.width, record)
