"""The robot, alone or in small scenes written as MJCF."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import pytest

from anm_mj.control.robot_description import RobotDescription, describe_robot
from anm_mj.control.robot_model import RobotModel

_ROBOT_XML = Path(__file__).resolve().parents[2] / "models" / "diff_drive" / "diff_drive.xml"


@pytest.fixture(scope="session")
def robot_xml() -> Path:
    return _ROBOT_XML


@pytest.fixture(scope="session")
def description() -> RobotDescription:
    return describe_robot(_ROBOT_XML)


@pytest.fixture(scope="session")
def robot_model() -> RobotModel:
    return RobotModel(_ROBOT_XML)


@pytest.fixture(scope="session")
def compile_scene() -> Callable[..., tuple[mujoco.MjModel, mujoco.MjData]]:
    """Compiles the robot on an infinite floor together with obstacles."""

    def compile_with(obstacles: str = "") -> tuple[mujoco.MjModel, mujoco.MjData]:
        spec = mujoco.MjSpec.from_file(str(_ROBOT_XML))
        floor = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
        floor.name = "floor"
        scene = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{obstacles}</worldbody></mujoco>")
        spec.attach(scene, prefix="scene/", frame=spec.worldbody.add_frame())
        model = spec.compile()
        return model, mujoco.MjData(model)

    return compile_with
