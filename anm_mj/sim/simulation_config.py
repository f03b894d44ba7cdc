"""What a simulated robot in a scene is made of, and realities: names for much of it at once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from anm_mj.errors import ConfigError
from anm_mj.people.people_config import PeopleConfig
from anm_mj.robot.robot_config import DEFAULT_ROBOT, IMAGE_PX, CameraConfig, RobotConfig
from anm_mj.sim.sensors.sensor_config import SENSORS, SensorConfig, sensor_config
from anm_mj.utils.close_names import close_name

if TYPE_CHECKING:
    from anm_mj.types import Pose2

DRIVES = ("kinematic", "physics")
POSES = ("true", "odometry", "slam")
LARGEST_SEED = 2**63 - 1
IDEAL = "ideal"
_ODOMETRY = ("odometry_alpha", "odometry_radius_error", "odometry_yaw_bias_deg_per_m")
_ODOMETRY += ("odometry_slip_share", "odometry_slip_m", "odometry_slip_deg")


class Reality(NamedTuple):
    """What a name stands for."""

    options: Mapping[str, str]
    """``drive``, ``pose`` and ``sensor``, as of :class:`SimulationConfig`."""
    settings: Mapping[str, Mapping[str, Any]]
    """Values by group and name."""

    @property
    def texts(self) -> tuple[str, ...]:
        """The settings as ``group.name=value``, without blanks."""
        pairs = ((f"{group}.{name}", value) for group, own in self.settings.items() for name, value in own.items())
        return tuple(f"{name}={value}".replace(" ", "") for name, value in pairs)


REALITIES: dict[str, Reality] = {
    # Exact images without delay, exact poses, exact motions, nobody else: the world of the paper.
    IDEAL: Reality({}, {}),
    # A stereo camera, wheels that slip by the odometry motion model (Thrun, Burgard and Fox, 2005, table 5.6), encoders
    # that err by two to three degrees in a hundred actions, torque and contact, three people, images that come late.
    "real": Reality(
        {"drive": "physics", "pose": "slam", "sensor": "d435i"},
        {
            "model": {"wheel_noise": 0.02},
            "sensor": {"odometry_alpha": (0.01, 0.01, 0.01, 0.01), "delay_s": 0.1},
            "people": {"number": 3},
        },
    ),
}
"""How much of what makes the world hard a simulation has, in one word: options and settings of a run; whatever is given
beside it goes before it. This is the only place that says which."""


@dataclass(frozen=True)
class SimulationConfig:
    """All that makes a simulated robot in a scene; runs, comparisons and environments have their defaults from here."""

    scene: str
    """Name from the catalogue, or path of a scene folder."""
    reality: str = IDEAL
    """The world that options and settings begin with: ``ideal`` (exact images, poses and motions, nobody else) or
    ``real`` (a stereo camera, late images, slipping wheels with localisation, physics, three people)."""
    robot: str = DEFAULT_ROBOT
    """Your robot's MJCF file, or a name: ``diff_drive``, ``stretch3``, ``turtlebot3_burger``, ``turtlebot3_waffle_pi``,
    or one of the package robot_descriptions."""
    drive: str = "kinematic"
    """How the robot executes actions: ``kinematic`` (exactly) or ``physics`` (wheel torque and contact)."""
    pose: str = "true"
    """Where poses come from: ``true``, wheel ``odometry``, or ``slam`` (odometry, corrected by localisation in
    the map)."""
    image_px: int = 256
    """Width and height of the camera image [px]."""
    start: tuple[float, float, float] | None = None
    """Start pose x [m], y [m], yaw [deg]; None = the scene's first where the robot can stand."""
    seed: int = 0
    """Seed of everything random: training, policy, localisation, noise, who moves, the place of an unknown start."""
    model: RobotConfig = field(default=cast(RobotConfig, None))
    """How to read the robot's file, and the noise of its encoders; without it, what the robot's name asks for."""
    camera: CameraConfig = field(default_factory=CameraConfig)
    """Optics and mount of the camera where they differ from the robot's file."""
    sensor: SensorConfig = field(default_factory=SensorConfig)
    """Errors of camera and odometry."""
    people: PeopleConfig = field(default_factory=PeopleConfig)
    """Who walks through the scene."""

    def __post_init__(self) -> None:
        """Fill in the settings of the named robot, and check the values. Raises ConfigError if a choice is unknown or a
        number out of range, and RobotError if the settings of the named robots cannot be read.
        """
        if self.model is None:
            from anm_mj.robot.robot_presets import preset_config  # Names alone should not cost the import of numpy.

            object.__setattr__(self, "model", preset_config(self.robot))
        require_choice("reality", self.reality, tuple(REALITIES))
        require_choice("drive", self.drive, DRIVES)
        require_choice("pose", self.pose, POSES)
        low, high = IMAGE_PX
        if not low <= self.image_px <= high:
            raise ConfigError(f"image_px is {self.image_px}; it must lie between {low} and {high}.")
        if not 0 <= self.seed <= LARGEST_SEED:
            raise ConfigError(f"The seed is {self.seed}; give a whole number from 0 up to {LARGEST_SEED}.")

    @property
    def without_effect(self) -> tuple[str, ...]:
        """Names of settings that differ from the usual ones, and that nothing in this simulation reads."""
        usual = SENSORS.get(self.sensor.name, SensorConfig())
        changed = [f"sensor.{name}" for name in _ODOMETRY if getattr(self.sensor, name) != getattr(usual, name)]
        changed += ["model.wheel_noise"] * (self.model.wheel_noise > 0.0)
        idle = [f"sensor.{name}" for name in self.sensor.without_effect] + changed * (self.pose == "true")
        if self.people.num_bodies == 0:
            nobody = PeopleConfig()
            names = [entry.name for entry in fields(PeopleConfig)]
            idle += [f"people.{name}" for name in names if getattr(self.people, name) != getattr(nobody, name)]
        begins_with = {f"{group}.{name}" for group, own in REALITIES[self.reality].settings.items() for name in own}
        return tuple(name for name in dict.fromkeys(idle) if name not in begins_with)

    @property
    def start_pose(self) -> Pose2 | None:
        """The start with its yaw in radians; None = the scene's first where the robot can stand."""
        if self.start is None:
            return None
        # Settings alone should not cost the import of numpy.
        from anm_mj.frames import wrap_angle
        from anm_mj.types import Pose2

        x_m, y_m, yaw_deg = self.start
        return Pose2(x_m, y_m, wrap_angle(math.radians(yaw_deg)))


def in_reality(name: str, robot: str, sensor: str = "") -> dict[str, Any]:
    """Fields of :class:`SimulationConfig` that a robot begins with in a reality, with the reality's sensor or a named
    one. Raises ConfigError if there is no such reality, and RobotError if there is no such sensor or the settings of
    the named robots cannot be read.
    """
    reality = reality_of(name)
    begins: dict[str, Any] = {**reality.options, "reality": name}
    if sensor := sensor or reality.options.get("sensor", ""):
        begins["sensor"] = replace(sensor_config(sensor), **reality.settings.get("sensor", {}))
    if noise := reality.settings.get("model"):
        from anm_mj.robot.robot_presets import preset_config  # Names alone should not cost the import of numpy.

        begins["model"] = replace(preset_config(robot), **noise)
    if people := reality.settings.get("people"):
        begins["people"] = PeopleConfig(**people)
    return begins


def reality_of(name: str) -> Reality:
    """What a name stands for. Raises ConfigError if there is no such reality."""
    require_choice("reality", name, tuple(REALITIES))
    return REALITIES[name]


def require_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Check that a setting is one of its choices. Raises ConfigError if it is not."""
    if value not in choices:
        raise ConfigError(
            f"There is no {name} '{value}'{close_name(value, choices)}; choose one of {', '.join(choices)}."
        )
