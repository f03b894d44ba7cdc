import math
import re
from pathlib import Path

import numpy as np
import pytest

from anm_mj.errors import RobotError
from anm_mj.robot.robot_config import CameraConfig
from anm_mj.sim.gl import select_backend

select_backend()

import mujoco  # noqa: E402

from anm_mj.robot.description import describe_robot  # noqa: E402
from tests.robots import ROBOT_XML, ROVER_XML  # noqa: E402

ROBOTS = [ROBOT_XML, ROVER_XML]


@pytest.fixture
def in_a_frame(tmp_path) -> Path:
    text = ROVER_XML.read_text()
    frames = r'<frame pos="0.01 0 0.02" euler="0 0 0.1"><frame pos="0 0 0.01" euler="0.1 0 0">\1</frame></frame>'
    text, count = re.subn(r'(<camera name="eye".*?/>)', frames, text)
    assert count == 1
    (tmp_path / "framed.xml").write_text(text)
    return tmp_path / "framed.xml"


@pytest.mark.parametrize("path", [*ROBOTS, None], ids=lambda path: "frame" if path is None else path.stem)
def test_the_camera_sits_where_the_settings_say(path, in_a_frame):
    path = path or in_a_frame
    plain = describe_robot(path)
    config = CameraConfig(fov_deg=69.0, height_m=0.2, tilt_deg=-30.0, width_px=64, height_px=36)
    mounted = describe_robot(path, camera=config)
    assert mounted.T_base_camera[2, 3] == pytest.approx(0.2)
    assert np.allclose(mounted.T_base_camera[:2, 3], plain.T_base_camera[:2, 3])
    tilt = math.degrees(math.asin(mounted.T_base_camera[2, 2]) - math.asin(plain.T_base_camera[2, 2]))
    assert tilt == pytest.approx(-30.0, abs=1e-6)
    assert mounted.hash != plain.hash
    # MuJoCo's camera is the one that is described.
    model = mounted.spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = data.camera(mounted.camera)
    root = model.body_rootid[model.camera(mounted.camera).bodyid[0]]
    T_world_root = np.eye(4)
    T_world_root[:3, :3], T_world_root[:3, 3] = data.xmat[root].reshape(3, 3), data.xpos[root]
    T_world_camera = T_world_root @ mounted.T_root_base @ mounted.T_base_camera
    assert np.allclose(camera.xpos, T_world_camera[:3, 3], atol=1e-9)
    assert np.allclose(-camera.xmat.reshape(3, 3)[:, 2], T_world_camera[:3, 2], atol=1e-9)
    fov_x = 2.0 * math.atan(math.tan(math.radians(model.camera(mounted.camera).fovy[0]) / 2.0) * 64 / 36)
    assert math.degrees(fov_x) == pytest.approx(69.0)


def test_without_settings_the_robot_is_the_same():
    assert describe_robot(ROBOTS[0]).hash == describe_robot(ROBOTS[0], camera=CameraConfig()).hash


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"fov_deg": 5.0}, "camera.fov_deg is 5"),
        ({"fov_deg": 179.0}, "camera.fov_deg is 179"),
        ({"fov_deg": math.nan}, "camera.fov_deg is nan"),
        ({"height_m": -1.0}, "camera.height_m is -1"),
        ({"tilt_deg": 60.0}, "camera.tilt_deg is 60"),
        ({"width_px": 4}, "camera.width_px is 4"),
        ({"height_px": -5}, "camera.height_px is -5"),
    ],
)
def test_impossible_cameras_are_refused(settings, says):
    with pytest.raises(RobotError, match=says):
        CameraConfig(**settings)
