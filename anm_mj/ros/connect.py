"""Finds the topics of a live robot and waits until all of them say something that fits together."""

import functools
import math
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass

from anm_mj.errors import RobotError
from anm_mj.io.rosbag import image_folders
from anm_mj.ros.commander import Commander
from anm_mj.ros.drive_config import DriveConfig
from anm_mj.ros.health import Health
from anm_mj.ros.live_robot import LiveRobot
from anm_mj.ros.names import CAMERA_INFO, COMPRESSED, IMAGE, ODOMETRY_TYPE, TF, TF_STATIC, TF_TYPE
from anm_mj.ros.navigation import ACTION, GoalTopic, NavigateAction, Navigation
from anm_mj.ros.node import FRAMES, SENSOR, STATE, Node
from anm_mj.ros.poses import TREE, Poses
from anm_mj.ros.rgbd_intake import RgbdIntake

_LOOK_S = 0.1
_SETTLE_S = 1.0
"""Nobody knows whether all publishers have been found; after this time, what there is counts [s]."""


@dataclass(frozen=True)
class Connection:
    """A live robot with what it is made of."""

    node: Node
    robot: LiveRobot
    poses: Poses
    health: Health
    navigation: Navigation | None = None
    """What drives the robot, where this program does not."""


@contextmanager
def connect(config: DriveConfig, is_over: Callable[[], bool]) -> Iterator[Connection]:
    """A robot that sends images and poses which fit together; it is stopped at the end. ``is_over``: whether the user
    wants an end. Raises RobotError if a topic is missing, ambiguous or silent within ``ros.wait_s``, and AnmError as
    :class:`~anm_mj.ros.node.Node`.
    """
    ros = config.ros
    health = Health(ros.timeout_s)
    with Node(ros.namespace, on_bad=lambda topic, what: health.fault(topic, f"{topic}: {what}")) as node:
        intake, poses = RgbdIntake(health, ros.depth_unit_m, ros.match_s), Poses(health, ros.base_frame)
        node.subscribe(TF, TF_TYPE, lambda message, of: poses.hear_frames(message, of, static=False), STATE)
        node.subscribe(TF_STATIC, TF_TYPE, lambda message, of: poses.hear_frames(message, of, static=True), FRAMES)
        end = time.monotonic() + ros.wait_s
        _subscribe(node, intake, poses, _topics(node, config, end, is_over))
        while (missing := _missing(intake, poses)) is not None:
            if is_over() or time.monotonic() > end:
                wrong = health.present()
                raise RobotError(f"The run cannot begin: {missing}{f' ({wrong})' if wrong else ''}.")
            time.sleep(_LOOK_S)
        for source in (*intake.sources, poses.source):
            health.expect(source)
        navigation = _navigation(node, config, end, is_over)
        with closing(Commander(node, ros, health, dry=config.dry or navigation is not None)) as commander:
            robot = LiveRobot(intake, poses, commander, health, config)
            robot.is_over = is_over
            try:
                yield Connection(node, robot, poses, health, navigation)
            finally:
                robot.close()


def _navigation(node: Node, config: DriveConfig, end: float, is_over: Callable[[], bool]) -> Navigation | None:
    """What drives the robot to goals; None where this program drives it, or nobody does. Raises RobotError if nobody
    offers the action.
    """
    if config.dry or config.ros.drive == "velocity":
        return None
    if config.ros.drive == "goal_pose":
        return GoalTopic(node)
    action = NavigateAction(node)
    while not action.is_there:
        if is_over() or time.monotonic() > end:
            raise RobotError(
                f"The run cannot begin: nobody offers the action {node.name(ACTION)} of nav2_msgs/NavigateToPose over "
                "Cyclone DDS; start nav2 with RMW_IMPLEMENTATION=rmw_cyclonedds_cpp, or set ros.drive to goal_pose."
            )
        time.sleep(_LOOK_S)
    return action


def _topics(node: Node, config: DriveConfig, end: float, is_over: Callable[[], bool]) -> dict[str, tuple[str, str]]:
    """Name and type of the topics of ``colour``, ``depth``, ``camera`` and ``odometry``. Raises RobotError if there is
    none, or several, of a role.
    """
    ros, images, settled = config.ros, (IMAGE, COMPRESSED), time.monotonic() + _SETTLE_S
    while True:
        choose = functools.partial(_choose, node, node.published())
        try:
            found = {
                "colour": choose(
                    "colour", ros.colour, images, lambda name: "depth" not in name and "infra" not in name
                ),
                "depth": choose("depth", ros.depth, images, lambda name: "depth" in name),
            }
            beside = [f"{folder}/camera_info" for folder in image_folders(found["depth"][0])]
            found["camera"] = choose("camera", ros.camera, (CAMERA_INFO,), beside.__contains__)
            if ros.odometry != TREE:
                of = (ODOMETRY_TYPE,)
                found["odometry"] = choose("odometry", ros.odometry, of, lambda name: "ground_truth" not in name)
        except LookupError as err:
            if is_over() or time.monotonic() > end:
                raise RobotError(f"The run cannot begin: {err}.") from err
        else:
            if time.monotonic() > settled:
                return found
        time.sleep(_LOOK_S)


def _choose(
    node: Node, there: dict[str, str], role: str, named: str, kinds: tuple[str, ...], fits: Callable[[str], bool]
) -> tuple[str, str]:
    """The topic that was named, or the only one of its type that fits; raises LookupError."""
    words = " or ".join(kind.replace("/msg/", "/") for kind in kinds)
    if named:
        name = node.name(named)
        if name not in there:
            raise LookupError(f"nobody publishes {name} (--topic {role}={named})")
        if there[name] not in kinds:
            raise LookupError(f"{name} is of type {there[name].replace('/msg/', '/')}, not {words}")
        return name, there[name]
    below = node.name("x")[:-1]
    fit = [name for name, kind in there.items() if kind in kinds and fits(name) and name.startswith(below)]
    # .../image_raw/compressed is the twin of .../image_raw.
    fit = [name for name in fit if name.rpartition("/")[0] not in fit]
    if not fit:
        raise LookupError(
            f"nobody publishes {words} for {role} in domain {node.number}; name it by --topic {role}=NAME"
        )
    if len(fit) > 1:
        raise LookupError(f"{', '.join(sorted(fit))} may be {role}; name one by --topic {role}=NAME")
    return fit[0], there[fit[0]]


def _subscribe(node: Node, intake: RgbdIntake, poses: Poses, topics: dict[str, tuple[str, str]]) -> None:
    intake.colour, intake.depth, intake.camera = (topics[role][0] for role in ("colour", "depth", "camera"))
    poses.source = TREE if "odometry" not in topics else f"the odometry on {topics['odometry'][0]}"
    if "odometry" in topics:
        node.subscribe(*topics["odometry"], lambda message, _: poses.hear_odometry(message), SENSOR)
    node.subscribe(*topics["camera"], lambda message, _: intake.hear_camera(message), SENSOR)
    node.subscribe(*topics["colour"], lambda message, _: intake.hear_colour(message), SENSOR)
    node.subscribe(*topics["depth"], lambda message, _: intake.hear_depth(message), SENSOR)


def _missing(intake: RgbdIntake, poses: Poses) -> str | None:
    """What the run still waits for; None when image, camera, pose and frames are there."""
    seen = intake.wait_newer(intake.latest_s, 0.0)
    if seen is None:
        if not intake.has_camera:
            return f"no calibration came on {intake.camera}"
        return f"no pair of images came on {intake.colour} and {intake.depth}"
    if poses.latest_s == -math.inf:
        return f"no pose came ({poses.source})"
    if poses.base(poses.latest_s) is None:
        return f"the frames on tf and tf_static do not say where '{poses.base_frame}' is on the robot"
    if poses.base(seen.time_s) is None:
        return (
            f"no pose of the base is known at the time of the images: {intake.depth} has the stamp {seen.time_s:.3f} "
            f"s, and {poses.source} {poses.latest_s:.3f} s"
        )
    if poses.camera(seen.frame, seen.time_s) is None:
        return (
            f"the frames on tf and tf_static do not lead from '{poses.base_frame}' to '{seen.frame}', the frame of "
            f"{intake.depth}"
        )
    return None
