"""The body of the robot of a simulation, without MuJoCo where the robot is the usual one."""

from anm_mj.robot.robot_config import DEFAULT_ROBOT, RobotConfig
from anm_mj.robot.robot_presets import robot_path
from anm_mj.sim.gl import select_backend
from anm_mj.sim.simulation_config import SimulationConfig
from anm_mj.types import DEFAULT_FOOTPRINT, Footprint


def footprint_of(config: SimulationConfig) -> Footprint:
    """The footprint of a robot. Raises RobotError if there is no such robot, or its file cannot be read."""
    path = robot_path(config.robot)
    if config.robot == DEFAULT_ROBOT and config.model == RobotConfig():
        return DEFAULT_FOOTPRINT
    select_backend()  # MuJoCo, which reads the file, must not be imported before.
    from anm_mj.sim.describe_file import describe_file

    return describe_file(path, config.model, config.camera, config.image_px).footprint
