"""Fixtures and stand-ins for tests of robots and drives; each folder's conftest.py imports the fixtures."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from anm_mj.geometry.clearance import Clearance
from anm_mj.robot.description import RobotDescription, describe_robot
from anm_mj.robot.kinematics import RobotKinematics
from anm_mj.types import Footprint

ROBOT_XML = Path(__file__).resolve().parents[1] / "models" / "diff_drive" / "diff_drive.xml"
ROVER_XML = Path(__file__).resolve().parent / "rover.xml"
FOOTPRINT = Footprint(radius_m=0.18, z_min_m=0.05, z_max_m=1.35)
"""Of the robot in ``models/diff_drive``."""


def clearance_of(*meshes: trimesh.Trimesh, footprint: Footprint = FOOTPRINT) -> Clearance:
    """The clearance of a footprint among some meshes; among none, everything is free."""
    mesh = trimesh.util.concatenate(list(meshes)) if meshes else trimesh.Trimesh()
    vertices = np.asarray(mesh.vertices, dtype=float).reshape(-1, 3)
    return Clearance(vertices, np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3), footprint)


@pytest.fixture(scope="session")
def description() -> RobotDescription:
    return describe_robot(ROBOT_XML)


@pytest.fixture(scope="session")
def kinematics(description) -> RobotKinematics:
    return RobotKinematics(description)


@pytest.fixture(scope="session")
def compile_scene() -> Callable[..., tuple[mujoco.MjModel, mujoco.MjData]]:
    """Compiles the robot on an infinite floor together with obstacles."""

    def compile_with(obstacles: str = "") -> tuple[mujoco.MjModel, mujoco.MjData]:
        spec = mujoco.MjSpec.from_file(str(ROBOT_XML))
        floor = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
        floor.name = "floor"
        scene = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{obstacles}</worldbody></mujoco>")
        spec.attach(scene, prefix="scene/", frame=spec.worldbody.add_frame())
        model = spec.compile()
        return model, mujoco.MjData(model)

    return compile_with


def let_wheel_stick(model: mujoco.MjModel, *, left: bool, prefix: str = "") -> None:
    """Let a wheel of the builtin robot stick, in a simulation by physics."""
    joint = prefix + ("wheel_left" if left else "wheel_right")
    model.dof_damping[model.joint(joint).dofadr] = 1e3
