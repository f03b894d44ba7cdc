"""Settings of the exploration task."""

import dataclasses
import math
from pathlib import Path
from typing import Any, cast

import numpy as np

from anm_mj.control.speed_and_acceleration import MotionLimits
from anm_mj.environments.actions import ACTION_SETS, CONTROL_S
from anm_mj.errors import ConfigError, RobotError, TaskError
from anm_mj.people.people_config import PeopleConfig
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.sim.simulation_config import IDEAL, SimulationConfig, in_reality, reality_of
from anm_mj.types import FORWARD_STEP_M
from anm_mj.utils.settings import of_type

REACH_M = 1000.0
"""Largest distance from the start within an episode [m]; bounds the observed position in every scene."""
MAX_STEPS = int(REACH_M / (FORWARD_STEP_M + 0.001))
"""Longest episode of discrete actions [steps]; the physics drive may overshoot a step by a millimetre."""
MAX_VELOCITY_STEPS = int(0.99 * REACH_M / (MotionLimits().forward_mps * CONTROL_S))
POSES = ("true", "odometry")
REWARDS = ("surface", "area", "information")


@dataclasses.dataclass(frozen=True)
class EnvironmentConfig:
    """Settings of an episode of exploration, apart from the scene."""

    num_steps: int | None = None
    """Steps until truncation; None = the scene's budget, or else by its floor."""
    start: tuple[float, float, float] | None = None
    """Start pose x [m], y [m], yaw [deg] of every episode; None = a random reachable pose per episode."""
    reality: str = IDEAL
    """``ideal``, or ``real``: physics, a stereo camera whose images are late, odometry that drifts, three people.
    Options beside it go before it. Nothing localises the robot here, so that its pose is that of odometry."""
    drive: str = dataclasses.field(default=cast(str, None))
    """Execution of actions: ``kinematic`` (exact) or ``physics`` (wheel torque and contact); None = that of the
    reality."""
    pose: str = dataclasses.field(default=cast(str, None))
    """What the observed pose is: ``true``, or by wheel ``odometry``; None = that of the reality."""
    image_px: int = 128
    """Width and height of the camera's images [px]. From 128 on the reward equals the evaluation's measure; fewer
    pixels cover slightly less."""
    sensor: str = dataclasses.field(default=cast(str, None))
    """Name of the sensor whose errors the observations have; the reward counts what it truly saw. None = that of the
    reality."""
    people: int = dataclasses.field(default=cast(int, None))
    """Number of people who walk through the scene; surface that they hide is not seen. None = that of the reality."""
    topdown: bool = False
    """Whether the observation includes an occupancy map around the robot."""
    distance: bool = False
    """Whether the observation includes the signed distance to the nearest obstacle around the robot."""
    robot: str = SimulationConfig.robot
    """Name of a builtin robot, or an MJCF file."""
    actions: str = "discrete"
    """``discrete`` (forward, left, right), or ``velocity`` (forward and turn, each held for 0.2 s)."""
    stop: bool = True
    """Whether STOP, which ends the episode, is among the discrete actions."""
    reward: str = "surface"
    """What is rewarded: new ``surface`` (share of the observable one), new ``area`` of the top-down map [m2], or the
    ``information`` that the occupancy grid gains [bits]."""

    def __post_init__(self) -> None:
        """Fill in what the reality says of the options that are not given, and check the values. Raises TaskError for
        an unknown reality, drive, pose or sensor, or a number out of range.
        """
        try:
            for name, value in _options_of(self.reality).items():
                if getattr(self, name) is None:
                    object.__setattr__(self, name, value)
        except ConfigError as err:
            raise TaskError(str(err)) from err
        if self.num_steps is not None and not 1 <= self.num_steps <= self.max_steps:
            raise TaskError(f"num_steps is {self.num_steps}; an episode has 1 to {self.max_steps} steps.")
        if self.actions not in ACTION_SETS:
            raise TaskError(f'There are no actions "{self.actions}"; choose one of {", ".join(ACTION_SETS)}.')
        if self.pose not in POSES:
            raise TaskError(f'There is no pose "{self.pose}" here; choose one of {", ".join(POSES)}.')
        if self.reward not in REWARDS:
            raise TaskError(f'There is no reward "{self.reward}"; choose one of {", ".join(REWARDS)}.')
        try:
            self.simulation  # noqa: B018
        except (ConfigError, RobotError) as err:
            raise TaskError(str(err)) from err

    @property
    def simulation(self) -> SimulationConfig:
        """What the simulated robot is made of; every episode has its own scene, start and seed."""
        given = {name: getattr(self, name) for name in ("robot", "drive", "pose", "image_px")}
        given["people"] = PeopleConfig(number=self.people)
        return SimulationConfig("", **in_reality(self.reality, self.robot, self.sensor) | given)

    @property
    def max_steps(self) -> int:
        """Longest episode [steps]."""
        return MAX_VELOCITY_STEPS if self.actions == "velocity" else MAX_STEPS


def explore_config(**options: Any) -> EnvironmentConfig:
    """A configuration from options. Raises TaskError for an unknown one, an invalid start, or a wrong value."""
    known = {field.name: field.default for field in dataclasses.fields(EnvironmentConfig)}
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise TaskError(f'The task has no option "{unknown[0]}"; it has {", ".join(known)}.')
    given = {name: _of_type(name, value) for name, value in options.items() if value is not known[name]}
    return EnvironmentConfig(**given)


def _of_type(name: str, value: Any) -> Any:
    """The value of an option as its type; numbers of NumPy and paths, too. Raises TaskError if it is of another one."""
    if name == "start":
        require_start(value)
        return value
    plain = value.item() if isinstance(value, np.generic) else str(value) if isinstance(value, Path) else value
    try:
        return of_type(EnvironmentConfig, name, plain)
    except ValueError as err:
        said = str(err).replace("null", "None")
        raise TaskError(f"{name} is {value!r} ({said}); give a value of the right type.") from err


def _options_of(reality: str) -> dict[str, Any]:
    """What a reality says of drive, pose, sensor and people. Raises ConfigError if there is none of the name."""
    world = reality_of(reality)
    number = world.settings.get("people", {}).get("number", PeopleConfig.number)
    usual = {"drive": SimulationConfig.drive, "pose": SimulationConfig.pose, "sensor": SensorConfig.name}
    found = {**usual, **world.options, "people": number}
    # Nothing localises the robot here.
    return {**found, "pose": "odometry"} if found["pose"] == "slam" else found


def require_start(start: Any) -> None:
    """Check that a start is three finite numbers. Raises TaskError if it is not."""
    try:
        good = len(start) == 3 and all(math.isfinite(value) for value in start)
    except TypeError:
        good = False
    if not good:
        raise TaskError(f"The start {start!r} is no pose; give three numbers: x [m], y [m], yaw [deg].")
