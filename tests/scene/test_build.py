import shutil

import numpy as np
import pytest
import trimesh

from anm_mj.errors import RobotError, SceneError
from anm_mj.scene.build import build_model
from anm_mj.scene.folder import load_scene
from anm_mj.scene.mjcf import COLLISION_GROUP, VISUAL_GROUP
from anm_mj.scene.submesh import Submesh
from anm_mj.scene.writer import SceneInfo, write_scene
from tests.scene.shapes import room

ROBOT = """
<mujoco model="ball"><worldbody><body name="base" pos="0 0 0.2"><freejoint name="free"/>
<geom name="shell" type="sphere" size="0.1" mass="1"/></body></worldbody></mujoco>
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    mesh = room()
    walls = Submesh("walls", mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32), (0.5, 0.6, 0.7))
    poster = Submesh(
        "poster",
        np.array([[2, 3.99, 1], [3, 3.99, 1], [3, 3.99, 2], [2, 3.99, 2]], np.float32),
        np.array([[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]], np.int32),
        uv=np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
        texture=np.full((4, 4, 3), 128, np.uint8),
    )
    folder = tmp_path_factory.mktemp("scene") / "room"
    return write_scene([walls, poster], SceneInfo("room", "tests", "CC0"), folder)


@pytest.fixture
def robot():
    import mujoco

    return mujoco.MjSpec.from_string(ROBOT)


def test_the_meshes_stand_where_the_geometry_says(scene):
    import mujoco

    model = build_model(scene)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    # The compiler moves every mesh to its own frame; the geom's pose takes it back.
    corners = []
    for geom in np.flatnonzero(model.geom_group == VISUAL_GROUP):
        mesh = model.geom_dataid[geom]
        first, num = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        local = model.mesh_vert[first : first + num]
        corners.append(local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    ours = np.unique(np.concatenate(corners).round(3) + 0.0, axis=0)
    theirs = np.unique(scene.triangles()[0].round(3) + 0.0, axis=0)
    assert np.allclose(ours, theirs, atol=2e-3)


def test_only_boxes_and_floor_collide_and_only_meshes_show(scene):
    model = build_model(scene)
    visual, solid = model.geom_group == VISUAL_GROUP, model.geom_group == COLLISION_GROUP
    assert (visual | solid).all()
    assert not model.geom_contype[visual].any()
    assert not model.geom_conaffinity[visual].any()
    assert model.geom_contype[solid].all()


def test_depth_range_is_in_metres(scene):
    model = build_model(scene)
    assert model.stat.extent == 1.0
    assert model.vis.map.znear == pytest.approx(0.02)
    assert model.vis.map.zfar >= 100.0


def test_the_robot_is_attached_at_the_origin_under_its_prefix(scene, robot):
    import mujoco

    model = build_model(scene, robot, prefix="bot/")
    body = model.body("bot/base")
    assert np.allclose(body.pos, [0.0, 0.0, 0.2])
    assert model.joint("bot/free").type == mujoco.mjtJoint.mjJNT_FREE
    assert model.nq == 7


def test_the_robot_rests_on_the_floor_and_stops_at_the_wall(scene, robot):
    import mujoco

    model = build_model(scene, robot)
    data = mujoco.MjData(model)
    data.qpos[:3] = [1.0, 2.0, 0.101]
    data.qvel[0] = -1.5
    deepest = np.inf
    for _ in range(1000):
        mujoco.mj_step(model, data)
        deepest = min(deepest, data.qpos[0])
    # The wall's face is at x = 0 and the ball's radius 0.1 m; the box may be one cell thicker and gives a little.
    assert 0.07 < deepest < 0.14
    assert data.qpos[2] == pytest.approx(0.1, abs=0.01)


def test_one_robot_can_be_put_into_many_models(scene, robot):
    assert [build_model(scene, robot).nq for _ in range(2)] == [7, 7]


def test_a_robot_that_goes_into_no_scene_is_named(scene, robot):
    robot.geom("shell").name = "floor"
    with pytest.raises(RobotError, match=r"Robot ball cannot be put into scene room: .*repeated name"):
        build_model(scene, robot, robot_name="ball", prefix="")


def test_a_scene_whose_assets_are_gone_is_named_and_not_the_robot_in_it(tmp_path, robot):
    mesh = room()
    part = Submesh("walls", mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32))
    scene = write_scene([part], SceneInfo("hollow", "tests", "CC0"), tmp_path / "hollow")
    for file in (scene.folder / "assets").iterdir():
        file.unlink()
    with pytest.raises(SceneError, match="Scene hollow cannot be compiled"):
        build_model(load_scene(scene.folder))
    with pytest.raises(SceneError, match="Scene hollow cannot be compiled"):
        build_model(load_scene(scene.folder), robot)


def test_many_parts_with_odd_names_compile(tmp_path):
    pieces = trimesh.util.concatenate([room()]).split(only_watertight=False)
    parts = [
        Submesh("Wand / №1 <&>", np.asarray(p.vertices, np.float32), np.asarray(p.faces, np.int32)) for p in pieces
    ]
    scene = write_scene(parts, SceneInfo("ünïcode <&>", "tests", "CC0"), tmp_path / "odd")
    assert build_model(scene).nmesh == len(parts)


def test_a_lone_triangle_compiles(tmp_path):
    floor, uv = room(), np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    walls = Submesh("walls", floor.vertices.astype(np.float32), floor.faces.astype(np.int32))
    corners = np.array([[2, 3.9, 1], [3, 3.9, 1], [3, 3.9, 2]], np.float32)
    texture = np.full((4, 4, 3), 9, np.uint8)
    plain = Submesh("flag", corners, np.array([[0, 1, 2]], np.int32), rgb=(1.0, 0.0, 0.0))
    painted = Submesh("sign", corners, np.array([[0, 1, 2]], np.int32), uv=uv, texture=texture)
    scene = write_scene([walls, plain, painted], SceneInfo("flags", "tests", "CC0"), tmp_path / "flags")
    assert build_model(scene).nmesh == 3


def test_a_scene_that_draws_something_else_than_it_states_is_refused(scene, robot, tmp_path):
    folder = tmp_path / "room"
    shutil.copytree(scene.folder, folder)
    (folder / "scene.xml").write_text("<mujoco><worldbody/></mujoco>")
    for model in (None, robot):
        with pytest.raises(SceneError, match=r"draws 0 triangles, but scene.toml states \d+: import the scene again"):
            build_model(load_scene(folder), model)
