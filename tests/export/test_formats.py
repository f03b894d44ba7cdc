"""Every format is read back, by another reader than ours where there is one, and compared with the run."""

import dataclasses
import json
import shutil
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree

import networkx
import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from anm_mj.cli.main import main
from anm_mj.export import formats
from anm_mj.export.figures import topdown_of
from anm_mj.export.formats import FORMATS, export_run
from anm_mj.export.rosbag import export_rosbag
from anm_mj.export.trajectory import export_tum
from anm_mj.export.wall_clock import began_s, on_wall_clock
from anm_mj.frames import pixel_directions, pose_matrix, transform_points
from anm_mj.io.bag_poses import FrameTree
from anm_mj.io.changes_file import write_changes
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.read_run import read_run
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.types import SurfaceChange
from tests.box_room import ROOM_HIGH_M, ROOM_LOW_M, room_plan
from tests.replay.conftest import box_run

STARTED_S = 1777627800.0
"""What the manifest of the box's run says [s since 1970]."""


@pytest.fixture(scope="module")
def out(run_folder, tmp_path_factory):
    folder = tmp_path_factory.mktemp("export")
    assert main(["export", str(run_folder), "--format", "all", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def run(run_folder):
    return read_run(run_folder)


def to_wall_m(points):
    """Distance of points to the nearest wall of the box room."""
    return np.abs(np.minimum(points - ROOM_LOW_M, ROOM_HIGH_M - points)).min(axis=1)


@pytest.mark.parametrize("suffix", ["glb", "ply", "obj"])
def test_mesh(run, out, suffix):
    ours = trimesh.load_mesh(run.folder.mesh, process=False)
    mesh: Any = trimesh.load(out / f"mesh.{suffix}", force="mesh", process=False)
    assert len(mesh.faces) == len(ours.faces)
    assert mesh.area == pytest.approx(ours.area, rel=1e-5)
    low, high = np.asarray(mesh.bounds)
    if suffix == "glb":  # y up, north to -z.
        low, high = np.array([low[0], -high[2], low[1]]), np.array([high[0], -low[2], high[1]])
    np.testing.assert_allclose([low, high], [ROOM_LOW_M, ROOM_HIGH_M], atol=1e-5)
    assert np.asarray(mesh.visual.vertex_colors)[0, :3].tolist() == [200, 180, 160]


def test_trajectories(run, out):
    camera = np.loadtxt(out / "trajectory_camera.tum")
    kitti = np.loadtxt(out / "trajectory_camera.kitti.txt").reshape(-1, 3, 4)
    base = np.loadtxt(out / "trajectory_base.tum")
    assert len(camera) == len(kitti) == len(base) == len(run.frames)
    for k, frame in enumerate(run.frames):
        np.testing.assert_allclose(
            Rotation.from_quat(camera[k, 4:]).as_matrix(), frame.T_world_camera[:3, :3], atol=1e-7
        )
        np.testing.assert_allclose(camera[k, :4], [frame.time_s, *frame.T_world_camera[:3, 3]], atol=1e-7)
        np.testing.assert_allclose(kitti[k], frame.T_world_camera[:3], atol=1e-7)
        np.testing.assert_allclose(base[k, 1:3], frame.pose.xy_m, atol=1e-7)


def test_nerfstudio_pixels_lie_on_the_walls(run, out):
    facts = json.loads((out / "nerfstudio" / "transforms.json").read_text())
    assert len(facts["frames"]) == len(run.frames)
    for entry in facts["frames"][::8]:
        with Image.open(out / "nerfstudio" / entry["file_path"]) as image:
            assert image.size == (facts["w"], facts["h"]) == (256, 256)
        with Image.open(out / "nerfstudio" / entry["depth_file_path"]) as image:
            depth_m = np.asarray(image) * facts["depth_unit_scale_factor"]
        row, col = np.mgrid[:128:7, :128:7]
        z = depth_m[row, col]
        # nerfstudio's camera looks along -z, with y up; the depth has every second pixel of the image.
        x = (2 * col + 0.5 - facts["cx"]) / facts["fl_x"] * z
        y = -(2 * row + 0.5 - facts["cy"]) / facts["fl_y"] * z
        points = np.stack([x, y, -z, np.ones_like(z)], axis=-1).reshape(-1, 4) @ np.array(entry["transform_matrix"]).T
        assert to_wall_m(points[:, :3]).max() < 0.002
    cloud: Any = trimesh.load(out / "nerfstudio" / facts["ply_file_path"])
    assert to_wall_m(np.asarray(cloud.vertices)).max() < 1e-5


def test_colmap_points_project_to_the_depth_of_the_run(run, out):
    model = out / "colmap" / "sparse" / "0"
    camera = lines_of(model / "cameras.txt")[0].split()
    assert camera[1] == "PINHOLE"
    fx, fy, cx, cy = map(float, camera[4:])
    points = np.array([[float(word) for word in line.split()[1:7]] for line in lines_of(model / "points3D.txt")])
    assert (points[:, 3:] == [200, 180, 160]).all()
    images = lines_of(model / "images.txt")[::2]
    assert len(images) == len(run.frames)
    for line, frame in list(zip(images, run.frames, strict=True))[::8]:
        words = line.split()
        w, x, y, z = map(float, words[1:5])
        seen = points[:, :3] @ Rotation.from_quat([x, y, z, w]).as_matrix().T + [float(word) for word in words[5:8]]
        assert (out / "colmap" / "images" / words[9]).is_file()
        seen = seen[seen[:, 2] > 0.1]
        u, v = fx * seen[:, 0] / seen[:, 2] + cx, fy * seen[:, 1] / seen[:, 2] + cy
        inside = (u >= 1) & (u < 255) & (v >= 1) & (v < 255)
        assert inside.sum() > 50
        measured = run.depth_mm(frame)[(v[inside] / 2).astype(int), (u[inside] / 2).astype(int)] / 1000.0
        # Half a pixel to the side, walls seen at a slant are some centimetres nearer or farther.
        assert np.median(np.abs(measured - seen[inside, 2])) < 0.02


def test_nav2_map_is_the_top_down_map(out):
    facts = yaml.safe_load((out / "map.yaml").read_text())
    with Image.open(out / facts["image"]) as image:
        grey = np.asarray(image).astype(float)
    share = (255.0 - grey[::-1]) / 255.0
    state = np.where(share > facts["occupied_thresh"], 1, np.where(share < facts["free_thresh"], 0, -1))
    topdown = room_plan().topdown
    assert topdown is not None
    np.testing.assert_array_equal(state, topdown.state)
    assert facts["resolution"] == topdown.resolution_m
    np.testing.assert_allclose(facts["origin"], [*topdown.origin_xy_m, 0.0])
    assert (facts["negate"], facts["mode"]) == (0, "trinary")


def test_graph(run, out):
    graph = room_plan().graph
    assert graph is not None
    read = networkx.read_graphml(out / "graph.graphml", node_type=int)
    assert networkx.number_connected_components(read) == 1
    assert {tuple(sorted(edge)) for edge in read.edges} == {tuple(edge) for edge in graph.edges.tolist()}
    for k, data in read.nodes(data=True):
        np.testing.assert_allclose([data["x_m"], data["y_m"]], graph.vertex_xy_m[k], atol=1e-6)
    length = networkx.shortest_path_length(read, 0, 3, weight="length_m")
    assert length == pytest.approx(graph.edge_length_m[:3].sum(), rel=1e-6)
    features = json.loads((out / "graph.geojson").read_text())["features"]
    kinds = [feature["properties"]["kind"] for feature in features]
    assert [kinds.count(kind) for kind in ("vertex", "edge", "region", "trajectory")] == [5, 4, 2, 1]
    trajectory = np.array(features[-1]["geometry"]["coordinates"])
    np.testing.assert_allclose(trajectory, [frame.pose.xy_m for frame in run.frames])


def test_route_graph_is_as_navs_route_server_loads_it(out):
    graph = room_plan().graph
    assert graph is not None
    features = json.loads((out / "route.geojson").read_text())["features"]
    nodes = {one["properties"]["id"]: one for one in features if one["geometry"]["type"] == "Point"}
    edges = [one for one in features if one["geometry"]["type"] == "MultiLineString"]
    assert {one["properties"]["frame"] for one in nodes.values()} == {"map"}
    # No number stands for two things, vertices and edges alike.
    assert len({one["properties"]["id"] for one in features}) == len(features)
    ways = {(one["properties"]["startid"], one["properties"]["endid"]): one for one in edges}
    assert len(ways) == len(edges) == 2 * len(graph.edges)
    assert {tuple(edge) for edge in graph.edges.tolist()} == {way for way in ways if way[0] < way[1]}
    for (start, end), one in ways.items():
        assert (end, start) in ways
        (line,) = one["geometry"]["coordinates"]
        assert line == [nodes[start]["geometry"]["coordinates"], nodes[end]["geometry"]["coordinates"]]
        assert one["properties"]["cost"] == pytest.approx(np.linalg.norm(np.subtract(*line)))


def test_all_takes_what_can_be_had_and_names_what_is_left_out(run_folder, tmp_path, monkeypatch, capsys):
    for name in ("steps.jsonl", "frames.jsonl", "camera.json", "trajectory.tum", "depth"):
        (tmp_path / name).symlink_to(run_folder / name)
    monkeypatch.setattr(formats, "find_spec", lambda module: None)
    assert main(["export", str(tmp_path), "--format", "all", "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    assert "trajectory_base.tum" in said.out
    assert (
        "Left out: rosbag. This needs the package rosbags, which is not installed: pip install 'anm-mj[ros]'."
        in said.err
    )
    assert "Left out: colmap. " in said.err
    assert main(["export", str(tmp_path), "--format", "rosbag", "--out", str(tmp_path / "out")]) == 2


def test_images_of_a_run_that_kept_small_ones_are_exported_with_a_warning(tmp_path, caplog):
    path = box_run(tmp_path / "box", 3)
    export_run(path, ["nerfstudio"], tmp_path / "out")
    assert "explore with --keep-images" in caplog.text


def test_signed_distances(run_folder, out):
    with np.load(out / "sdf.npz") as data:
        volume = dict(data)
    known = np.argwhere(np.isfinite(volume["sdf_m"]))
    np.testing.assert_array_equal(np.isfinite(volume["sdf_m"]), volume["state"] != -1)
    points = volume["origin_m"] + known[:, ::-1] * volume["spacing_m"]
    chosen = np.random.default_rng(0).choice(len(points), 2_000, replace=False)
    neural_map = NeuralMap.load(RunFolder(run_folder).map, device="cpu")
    np.testing.assert_allclose(volume["sdf_m"][tuple(known[chosen].T)], neural_map.sdf(points[chosen]), atol=1e-5)
    free = volume["state"][tuple(known.T)] == 0
    inside = np.minimum(points - ROOM_LOW_M, ROOM_HIGH_M - points).min(axis=1)
    # What is free lies in the room, whichever way the axes are read.
    assert np.percentile(inside[free], 1) > -0.1


def test_the_slice_of_distances_is_not_cut_off(out):
    with np.load(out / "esdf.npz") as data:
        field = dict(data)
    rows, cols = field["esdf_m"].shape
    col, row = np.round((np.array([1.2, 0.0]) - field["origin_xy_m"]) / field["spacing_m"]).astype(int)
    assert 0 <= row < rows
    assert 0 <= col < cols
    # More than half a metre from the walls the floor is nearest, at the height of the slice.
    assert field["esdf_m"][row, col] == pytest.approx(float(field["height_m"]), abs=0.15)
    assert field["height_m"] == pytest.approx(0.5, abs=0.06)


def test_rosbag(run, out):
    told, qos = _read_bag(out / "rosbag")
    assert len(told["/tf"]) == len(told["/odom"]) == len(told["/camera/depth/image_raw"]) == len(run.frames)
    tree = _tree(told)
    assert tree.chain("camera_optical_frame") == ["camera_optical_frame", "camera_link", "base_link", "odom", "map"]
    for odometry, depth, frame in zip(told["/odom"], told["/camera/depth/image_raw"], run.frames, strict=True):
        at = odometry.header.stamp
        now_s = at.sec + at.nanosec * 1e-9
        assert now_s == pytest.approx(STARTED_S + frame.time_s, abs=1e-6)
        assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
        place, q = odometry.pose.pose.position, odometry.pose.pose.orientation
        np.testing.assert_allclose([place.x, place.y], frame.pose.xy_m, atol=1e-9)
        assert 2.0 * np.arctan2(q.z, q.w) == pytest.approx(frame.pose.yaw_rad, abs=1e-9)
        np.testing.assert_allclose(tree.pose("base_link", "map", now_s), pose_matrix(frame.pose), atol=1e-5)
        np.testing.assert_allclose(tree.pose("camera_optical_frame", "map", now_s), frame.T_world_camera, atol=1e-5)
        np.testing.assert_array_equal(depth.data.view("<u2").reshape(depth.height, -1), run.depth_mm(frame))
    ahead = tree.pose("camera_link", "map", now_s)  # pyright: ignore[reportPossiblyUnboundVariable]
    assert ahead is not None
    np.testing.assert_allclose(ahead[:3, 0], run.frames[-1].T_world_camera[:3, 2], atol=1e-5)
    assert {one.format for one in told["/camera/color/image_raw/compressed"]} == {"rgb8; jpeg compressed bgr8"}
    assert [one.data for one in told["/plan/reason"]] == [plan["reason"] for plan in run.plans]
    info = told["/map"][0].info
    topdown = room_plan().topdown
    assert topdown is not None
    cells = told["/map"][0].data.reshape(info.height, info.width)
    np.testing.assert_array_equal(np.select([cells == 100, cells == 0], [1, 0], -1), topdown.state)
    np.testing.assert_allclose([info.origin.position.x, info.origin.position.y], topdown.origin_xy_m)
    cloud = told["/surface"][0]
    points = cloud.data.reshape(-1, cloud.point_step)[:, :12].copy().view("<f4")
    assert to_wall_m(points).max() < 1e-5
    assert {name for name, each in qos.items() if each} == {"/tf_static", "/map", "/surface"}
    for name in ("/tf_static", "/map", "/surface"):
        (offered,) = qos[name]
        assert offered.durability is QosDurability.TRANSIENT_LOCAL
        assert offered.reliability is QosReliability.RELIABLE


def _read_bag(path):
    """Messages, and the QoS offered, of each topic of a bag."""
    told, qos = {}, {}
    connection: Any
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, _, raw in reader.messages():
            told.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
            qos[connection.topic] = connection.ext.offered_qos_profiles
    return told, qos


def _tree(told):
    """The tree of frames that a listener builds."""
    tree: Any = FrameTree()
    for topic in ("/tf", "/tf_static"):
        for link in (link for message in told[topic] for link in message.transforms):
            at, (t, q) = link.header.stamp, (link.transform.translation, link.transform.rotation)
            pose = np.array([t.x, t.y, t.z, q.x, q.y, q.z, q.w])
            parent, child = link.header.frame_id, link.child_frame_id
            tree.add(parent, child, at.sec + at.nanosec * 1e-9, pose, static=topic == "/tf_static")
    return tree


def test_a_camera_that_moves_on_its_robot_is_no_static_frame(run, tmp_path):
    turned = np.eye(4)
    turned[:3, :3] = Rotation.from_euler("y", 0.2).as_matrix()
    frames = [run.frames[0], dataclasses.replace(run.frames[1], T_world_camera=run.frames[1].T_world_camera @ turned)]
    export_rosbag(dataclasses.replace(run, frames=tuple(frames)), tmp_path)
    tree = _tree(_read_bag(tmp_path / "rosbag")[0])
    assert [tree.track[name].static for name in ("camera_optical_frame", "camera_link")] == [True, False]
    for frame in frames:
        found = tree.pose("camera_optical_frame", "map", frame.time_s)
        np.testing.assert_allclose(found, frame.T_world_camera, atol=1e-9)


def test_late_images_have_the_times_and_poses_at_which_they_were_taken(run, tmp_path):
    T_base_camera = np.linalg.inv(pose_matrix(run.frames[0].pose)) @ run.frames[0].T_world_camera
    late = [run.frames[0]]
    for before, frame in pairwise(run.frames):
        seen_from = pose_matrix(before.pose) @ T_base_camera
        late.append(dataclasses.replace(frame, T_world_camera=seen_from, image_age_s=0.04))
    late_run = dataclasses.replace(run, frames=tuple(late))
    export_rosbag(late_run, tmp_path)
    told = _read_bag(tmp_path / "rosbag")[0]
    tree = _tree(told)
    assert tree.track["camera_link"].static
    stamps = [message.header.stamp for message in told["/camera/depth/image_raw"]]
    taken_s = [stamp.sec + stamp.nanosec * 1e-9 for stamp in stamps]
    np.testing.assert_allclose(taken_s, [frame.time_s - frame.image_age_s for frame in late], atol=1e-6)
    for frame in late:
        found = tree.pose("camera_optical_frame", "map", frame.image_time_s)
        np.testing.assert_allclose(found, frame.T_world_camera, atol=1e-9)
        at = tree.pose("base_link", "map", frame.time_s)
        np.testing.assert_allclose(at, pose_matrix(frame.pose), atol=1e-9)
    (path, _) = export_tum(late_run, tmp_path)
    np.testing.assert_allclose(np.loadtxt(path)[:, 0], taken_s, atol=1e-6)


def test_times_of_a_recording(run, run_folder, tmp_path, capsys):
    assert began_s(run) == STARTED_S
    for manifest in ({}, {"started": None}, {"started": "soon"}):
        assert began_s(dataclasses.replace(run, manifest=manifest)) == run.folder.camera.stat().st_mtime
    live = dataclasses.replace(run, frames=on_wall_clock(run, None).frames)
    assert on_wall_clock(live, None).frames[-1].time_s == live.frames[-1].time_s
    lasts_s = live.frames[-1].time_s - live.frames[0].time_s
    for start_s in (0.0, 1893456000.0):
        again = on_wall_clock(live, start_s).frames
        assert (again[0].time_s, again[-1].time_s) == (start_s, pytest.approx(start_s + lasts_s, abs=1e-5))
    words = ["export", str(run_folder), "--format", "rosbag", "--out", str(tmp_path), "--start"]
    for given, begin_s in (("2030-01-01T01:00+01:00", 1893456000), ("2030-01-01", 1893456000), ("0", 0)):
        assert main([*words, given]) == 0
        with AnyReader([tmp_path / "rosbag"]) as reader:
            assert reader.start_time == begin_s * 10**9 + round(run.frames[0].time_s * 1e9)
    for given, why in (("noon", "is no time"), ("2040-01-01", "from 1970 to 2037"), ("-5", "from 1970 to 2037")):
        assert main([*words, given]) == 2
        assert why in " ".join(capsys.readouterr().err.split())


def test_a_bag_of_ours_is_a_sequence_again(run, out):
    sequence, layout = open_sequence(out / "rosbag", SequenceOptions(floor_m=0.0))
    assert (layout, len(sequence)) == ("rosbag", len(run.frames))
    for found, frame in zip(sequence.observations(), run.frames, strict=True):
        np.testing.assert_allclose(found.T_world_camera, frame.T_world_camera, atol=1e-9)
        np.testing.assert_allclose(found.depth_m * 1000.0, run.depth_mm(frame), atol=1e-3)
        assert abs(found.rgb.astype(int) - 128).max() <= 2
        camera = found.intrinsics
        points = pixel_directions(camera) * found.depth_m[..., None]
        assert to_wall_m(transform_points(found.T_world_camera, points.reshape(-1, 3))).max() < 0.002


def test_figures(out):
    with Image.open(out / "topdown.png") as picture:
        width, height = picture.size
    for name in ("topdown", "curve"):
        drawn = ElementTree.parse(out / f"{name}.svg").getroot()
        assert drawn.tag == "{http://www.w3.org/2000/svg}svg"
        assert len(list(drawn.iter("{http://www.w3.org/2000/svg}path"))) > 20
        assert (out / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    _, _, across, down = map(float, ElementTree.parse(out / "topdown.svg").getroot().attrib["viewBox"].split())
    # The margins differ by some pixels.
    assert across / down == pytest.approx(width / height, rel=0.02)


def test_the_figure_shows_what_changed_since_a_run_before(run_folder, tmp_path):
    shutil.copytree(run_folder, tmp_path / "run")
    folder = RunFolder(tmp_path / "run")
    gone = SurfaceChange("gone", np.array([[0.5, 0.5, 0.4], [0.6, 0.5, 0.4]]), 0.1)
    write_changes(folder.changes, folder.changed_voxels, [gone])
    said = [text.get_text() for text in topdown_of(read_run(folder.path)).legends[0].get_texts()]
    assert "gone since the prior run" in said
    assert "gone since the prior run" not in [
        text.get_text() for text in topdown_of(read_run(run_folder)).legends[0].get_texts()
    ]


def test_every_format_is_tested_here(out):
    assert {path.name for path in out.iterdir()} == {
        "mesh.glb", "mesh.ply", "mesh.obj", "trajectory_camera.tum", "trajectory_base.tum",
        "trajectory_camera.kitti.txt", "nerfstudio", "colmap", "map.yaml", "map.pgm", "graph.graphml", "graph.geojson",
        "route.geojson",
        "sdf.npz", "esdf.npz", "topdown.png", "topdown.pdf", "topdown.svg", "curve.png", "curve.pdf",
        "curve.svg", "rosbag",
    }  # fmt: skip
    assert len(FORMATS) == 15


def test_what_a_run_lacks_is_one_sentence(run_folder, tmp_path, capsys):
    for name in ("steps.jsonl", "frames.jsonl", "camera.json", "trajectory.tum", "depth"):
        (tmp_path / name).symlink_to(run_folder / name)
    for name, words in (
        ("glb", "has no mesh.ply"),
        ("colmap", "--keep-images"),
        ("nav2", "holds no top-down map"),
        ("sdf", "the run did not end"),
        ("gbl", "There is no format 'gbl' (did you mean glb?); choose from glb"),
    ):
        assert main(["export", str(tmp_path), "--format", name, "--out", str(tmp_path / "out")]) == 2
        assert words in " ".join(capsys.readouterr().err.split())
    assert [path.name for path in export_run(tmp_path, ["tum"])] == ["trajectory_camera.tum", "trajectory_base.tum"]
    assert (tmp_path / "export" / "trajectory_base.tum").is_file()


def test_a_damaged_file_is_named_and_not_copied(run_folder, tmp_path, capsys):
    shutil.copytree(run_folder, tmp_path / "run")
    depth = tmp_path / "run" / "depth" / "000000.png"
    depth.write_bytes(depth.read_bytes()[:-40])
    assert main(["export", str(tmp_path / "run"), "--format", "nerfstudio", "--out", str(tmp_path / "out")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert all(words in said for words in ("depth/000000.png cannot be read", "copy the run again"))


def test_poses_of_the_base_are_whole_lines_where_the_run_was_cut_off(run_folder, tmp_path):
    shutil.copytree(run_folder, tmp_path / "run")
    whole = (tmp_path / "run" / "trajectory.tum").read_bytes()
    (tmp_path / "run" / "trajectory.tum").write_bytes(whole[:-30])
    _, base = export_run(tmp_path / "run", ["tum"], tmp_path / "out")
    assert base.read_bytes() == whole


def lines_of(path):
    return [line for line in path.read_text().split("\n")[:-1] if not line.startswith("#")]


def test_frames_of_a_lost_robot_are_in_no_export(tmp_path):
    path = box_run(tmp_path / "box", 4)
    lines = read_jsonl(path / "frames.jsonl")
    lines[1]["localisation"] = {"state": "LOST", "usable": False}
    (path / "frames.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    out = tmp_path / "out"
    export_run(path, ["nerfstudio", "colmap", "tum", "kitti", "rosbag"], out)

    known = len(lines) - 1
    assert len(json.loads((out / "nerfstudio" / "transforms.json").read_text())["frames"]) == known
    assert len(list((out / "nerfstudio" / "images").iterdir())) == known
    images = (out / "colmap" / "sparse" / "0" / "images.txt").read_text()
    assert "000001" not in images
    assert len((out / "trajectory_camera.tum").read_text().splitlines()) == known
    assert len((out / "trajectory_camera.kitti.txt").read_text().splitlines()) == known
    assert len(open_sequence(out / "rosbag")[0]) == known
