"""Settings of a run on a live robot."""

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from anm_mj.config import RunConfig
from anm_mj.errors import ConfigError, RobotError
from anm_mj.planning.policies.registry import needs_truth
from anm_mj.types import Footprint
from anm_mj.utils.settings import Settings, setting


@dataclass(frozen=True)
class RosConfig(Settings, group="ros", error=RobotError):
    """Topics, frames, size and limits of a robot that speaks ROS 2; the defaults are those of ``anm-mj simulate``."""

    namespace: str = ""
    """What relative names of topics are below; empty = nothing."""
    colour: str = ""
    """Topic of the colour images, ``sensor_msgs/Image`` or ``CompressedImage``; empty = the only one there is."""
    depth: str = ""
    """Topic of the depth images, of the same pixels as the colour; empty = the only one there is."""
    camera: str = ""
    """Topic of the calibration; empty = ``camera_info`` beside the depth images."""
    odometry: str = ""
    """Topic of ``nav_msgs/Odometry``; empty = the only one there is, ``tf`` = the frames on ``/tf`` alone."""
    command: str = "cmd_vel"
    """Topic of the velocities."""
    drive: Literal["velocity", "goal_pose", "nav2"] = setting("velocity", choices=("velocity", "goal_pose", "nav2"))
    """Velocities, or goals for a navigation that is not ours: ``PoseStamped`` on ``goal_pose``, or nav2's
    ``NavigateToPose``."""
    stamped: bool = False
    """Whether velocities are ``geometry_msgs/TwistStamped`` instead of ``Twist``."""
    base_frame: str = ""
    """Frame of the base on the floor; empty = ``base_footprint`` where there is one, else the child of the odometry."""
    radius_m: float = setting(0.18, at_most=2.0)
    """Radius of the robot about its axis of rotation [m]."""
    low_m: float = setting(0.05, at_least=0.0)
    """The robot drives over what is lower than this [m]."""
    height_m: float = 1.35
    """Height of the robot [m]."""
    depth_unit_m: float = 0.001
    """Metres per unit of 16-bit depth."""
    max_range_m: float = setting(0.0, at_least=0.0)
    """Largest depth that the camera measures [m]; 0 = nobody says."""
    forward_mps: float = setting(0.3, at_most=2.0)
    """Highest speed [m/s]."""
    forward_mps2: float = setting(0.6, at_most=10.0)
    """Highest acceleration [m/s²]."""
    turn_radps: float = setting(1.0, at_most=6.0)
    """Highest turn rate [rad/s]."""
    turn_radps2: float = setting(2.5, at_most=50.0)
    """Highest angular acceleration [rad/s²]."""
    timeout_s: float = setting(0.22, at_least=0.02, at_most=10.0)
    """Without a new image or pose for so long, the robot stops [s]."""
    match_s: float = setting(0.03, at_least=0.0, at_most=1.0)
    """Colour and depth belong together where their stamps differ by no more than this [s]."""
    clearance_m: float = setting(0.01, at_least=0.0, at_most=1.0)
    """The robot stops where depth shows something nearer than this ahead of its radius, beside its way to rest [m]."""
    stall_s: float = setting(1.5, at_most=60.0)
    """A robot that does not move for so long although it is driven has met an obstacle [s]."""
    wait_s: float = setting(15.0, at_least=1.0, at_most=3600.0)
    """The run begins within so many seconds, or ends with what is missing [s]."""

    @property
    def footprint(self) -> Footprint:
        """The cylinder to keep clear of obstacles."""
        return Footprint(self.radius_m, self.low_m, self.height_m)


@dataclass(frozen=True)
class DriveConfig(RunConfig):
    """All that decides how a run on a live robot goes, apart from the robot and its surroundings."""

    COMMAND: ClassVar[str] = "drive"

    ros: RosConfig = field(default_factory=RosConfig)
    dry: bool = False
    """The robot is not driven: the run only maps, and shows what it would do."""

    def __post_init__(self) -> None:
        """Check the options. Raises ConfigError if poses or policy need what a live robot has not, and AnmError as
        :class:`anm_mj.config.RunConfig`.
        """
        super().__post_init__()
        if self.pose == "true":
            raise ConfigError("--pose is 'true', which nobody knows of a live robot; give odometry or slam.")
        if not self.ros.low_m < self.ros.height_m:
            raise ConfigError(
                f"ros.height_m is {self.ros.height_m:g} and ros.low_m {self.ros.low_m:g}: the robot would drive over "
                "what is as high as itself; give a lower ros.low_m."
            )
        if needs_truth(self.policy):
            raise ConfigError(f"Policy {self.policy} needs the true scene, which a live robot has not; choose another.")
