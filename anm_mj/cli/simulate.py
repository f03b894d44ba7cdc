"""``anm-mj simulate``: the simulated robot for other programs, as a ROS 2 robot."""

import math
from pathlib import Path
from typing import Annotated, Any

from anm_mj.cli.command_line import Fields, Option
from anm_mj.cli.option_types import Settings, refuse_idle, require_read
from anm_mj.errors import ConfigError
from anm_mj.sim.sensors.sensor_config import SENSORS


def _robot_fields() -> tuple[type, dict[str, Option]]:
    from anm_mj.config import OPTIONS
    from anm_mj.sim.simulation_config import SimulationConfig

    return SimulationConfig, {name: Option(OPTIONS[name]) for name in ("reality", "robot", "drive", "seed", "start")}


def simulate(
    scene: str,
    *,
    ros: bool = False,
    namespace: Annotated[str, Option("NAME")] = "",
    rate: Annotated[float, Option("N")] = 1.0,
    image_hz: Annotated[float | None, Option("HZ")] = None,
    duration: Annotated[float | None, Option("SECONDS")] = None,
    sensor: Annotated[str | None, Option(names=lambda: SENSORS)] = None,
    settings: Settings = (),
    **options: Annotated[Any, Fields(_robot_fields)],
) -> int:
    """Let other programs drive the simulated robot in a scene, or hear a recording, over ROS 2 without installing it.

    Example: anm-mj simulate home --ros

    Args:
        scene: name from the catalogue (anm-mj scene list), a scene folder, a file to import, or a ROS 2 bag to play
        ros: speak ROS 2 (DDS, domain ROS_DOMAIN_ID)
        namespace: of its topics, where there are several robots
        rate: simulated seconds per second; what cannot be drawn in time is left out
        image_hz: pairs of colour and depth per simulated second (default: 10)
        duration: end after so many simulated or recorded seconds; by default at Ctrl-C, or with the recording
        sensor: errors of the camera (exact by default), in detail by --set sensor.NAME=VALUE
        settings: settings of robot, camera, sensor and people, as in model.wheel_noise=0.02; may be repeated
        **options: fields of ``SimulationConfig``

    Raises:
        AnmError: scene, robot or network cannot be used.
    """
    from anm_mj.cli.console import PlainConsole
    from anm_mj.cli.progress import Interrupt
    from anm_mj.config import DEFAULT_PRESET, make_config
    from anm_mj.io.bag_files import is_recording
    from anm_mj.scene.folder import load_scene
    from anm_mj.scene.importing.import_on_demand import folder_of
    from anm_mj.sim.gl import select_backend

    if not ros:
        raise ConfigError("--ros is missing; it is the only way in which other programs can drive the robot so far.")
    if duration is not None and not duration > 0.0:
        raise ConfigError(f"--duration is {duration:g}; give a number of seconds above 0.")
    from anm_mj.ros.node import Node

    console = PlainConsole()
    if is_recording(Path(scene)):
        from anm_mj.ros.bag_player import play
        from anm_mj.ros.simulated_robot import require_rate

        given = {f"--{name}": value for name, value in options.items()}
        given |= {"--image-hz": image_hz, "--sensor": sensor, "--set": next(iter(settings), None)}
        refuse_idle(given, "a recording is played as it is; leave it out")
        require_rate(rate)
        with Node(namespace) as node, Interrupt(console, "Ending.") as interrupt:
            console.say(f"{scene} is played at {rate:g} times its time; Ctrl-C ends it.")
            count = play(
                Path(scene), node, rate=rate, until=lambda: interrupt.is_requested, duration_s=duration or math.inf
            )
        console.say(f"{count} messages were published.")
        return 0
    select_backend()
    config = make_config(
        DEFAULT_PRESET, list(settings), scene=folder_of(scene), sensor=sensor, pose="odometry", **options
    )
    require_read(settings, "model", "camera", "sensor", "people", "image_px")
    world = load_scene(config.scene)
    from anm_mj.ros.simulated_robot import SimulatedRosRobot
    from anm_mj.sim.make_robot import make_robot

    images = {} if image_hz is None else {"image_hz": image_hz}
    with Node(namespace) as node, make_robot(world, config, knows_start=False, forgets_textures=True) as robot:
        served = SimulatedRosRobot(robot, node, rate=rate, **images)
        with Interrupt(console, "Ending.") as interrupt:
            console.say(f"{world.name}: the robot listens to {node.name('cmd_vel')}; Ctrl-C ends it.")
            done = served.serve(lambda: interrupt.is_requested, duration or math.inf)
    console.say(
        f"{done.simulated_s:.1f} s simulated in {done.wall_s:.1f} s (real-time factor {done.rate:.2f}), "
        f"{done.contacts} contacts, {done.images} pairs of images, {done.skipped} left out."
    )
    return 0
