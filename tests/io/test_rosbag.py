"""Bags are written by the package rosbags as drivers publish, and read back as the frames that they were made from."""

import io
import math
import sqlite3
import struct
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from anm_mj.cli.main import main
from anm_mj.errors import RunFolderError
from anm_mj.io import bag_limits
from anm_mj.io.bag_poses import Track
from anm_mj.io.sequence_layouts import SequenceOptions, find_floor_m, open_sequence
from anm_mj.types import Intrinsics, Pose2
from tests.box_room import observe

CAMERA = Intrinsics.from_fov(64, 48, math.radians(100.0))
STORE = get_typestore(Stores.ROS2_HUMBLE)
T_BASE_CAMERA = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 1.25], [0.0, 0.0, 0.0, 1.0]])
COLOUR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"


def seen():
    return [observe(step, Pose2(0.1 * step, -0.2, 0.5 * step), CAMERA) for step in range(6)]


def make(kind, /, store=STORE, **fields):
    return store.types[kind](**fields)


def header(time_s, frame_id, store=STORE):
    stamp = make("builtin_interfaces/msg/Time", store, sec=int(time_s), nanosec=round((time_s % 1.0) * 1e9))
    more = {"seq": 0} if store is not STORE else {}
    return make("std_msgs/msg/Header", store, stamp=stamp, frame_id=frame_id, **more)


def image(time_s, array, encoding, store=STORE, pad=4, big=False):
    """An image whose rows end in bytes that mean nothing."""
    raw = np.ascontiguousarray(array.astype(array.dtype.newbyteorder(">" if big else "<")))
    rows = raw.view(np.uint8).reshape(len(array), -1)
    rows = np.pad(rows, ((0, 0), (0, pad)), constant_values=7)
    return make("sensor_msgs/msg/Image", store, header=header(time_s, "optical", store), height=array.shape[0],
                width=array.shape[1], encoding=encoding, is_bigendian=int(big), step=rows.shape[1],
                data=rows.ravel())  # fmt: skip


def compressed(time_s, data, words):
    data = np.frombuffer(data, np.uint8)
    return make("sensor_msgs/msg/CompressedImage", header=header(time_s, "optical"), format=words, data=data)


def calibration(time_s, store=STORE):
    region = make(
        "sensor_msgs/msg/RegionOfInterest", store, x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    k = np.array([CAMERA.fx, 0.0, CAMERA.cx - 0.5, 0.0, CAMERA.fy, CAMERA.cy - 0.5, 0.0, 0.0, 1.0])
    named = {"d": np.zeros(5), "k": k, "r": np.eye(3).ravel(), "p": np.zeros(12)}
    if store is not STORE:
        named = {name.upper(): value for name, value in named.items()}
    return make("sensor_msgs/msg/CameraInfo", store, header=header(time_s, "optical", store), height=CAMERA.height,
                width=CAMERA.width, distortion_model="plumb_bob", binning_x=0, binning_y=0, roi=region,
                **named)  # fmt: skip


def parts(T, store=STORE, point="geometry_msgs/msg/Vector3"):
    x, y, z = T[:3, 3].tolist()
    qx, qy, qz, qw = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
    return make(point, store, x=x, y=y, z=z), make("geometry_msgs/msg/Quaternion", store, x=qx, y=qy, z=qz, w=qw)


def tf(time_s, parent, child, T, store=STORE):
    xyz, q = parts(T, store)
    one = make("geometry_msgs/msg/TransformStamped", store, header=header(time_s, parent, store), child_frame_id=child,
               transform=make("geometry_msgs/msg/Transform", store, translation=xyz, rotation=q))  # fmt: skip
    return make("tf2_msgs/msg/TFMessage", store, transforms=[one])


def odometry(time_s, T):
    xyz, q = parts(T, point="geometry_msgs/msg/Point")
    pose = make("geometry_msgs/msg/PoseWithCovariance", covariance=np.zeros(36),
                pose=make("geometry_msgs/msg/Pose", position=xyz, orientation=q))  # fmt: skip
    nothing = make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
    twist = make("geometry_msgs/msg/TwistWithCovariance", covariance=np.zeros(36),
                 twist=make("geometry_msgs/msg/Twist", linear=nothing, angular=nothing))  # fmt: skip
    return make("nav_msgs/msg/Odometry", header=header(time_s, "odom"), child_frame_id="base", pose=pose, twist=twist)


def camera_pose(time_s, T):
    xyz, q = parts(T, point="geometry_msgs/msg/Point")
    pose = make("geometry_msgs/msg/Pose", position=xyz, orientation=q)
    return make("geometry_msgs/msg/PoseStamped", header=header(time_s, "world"), pose=pose)


def base_of(observation):
    return observation.T_world_camera @ np.linalg.inv(T_BASE_CAMERA)


def write_bag(path, messages, storage=StoragePlugin.SQLITE3, compression=CompressionMode.NONE):
    """Write (topic, time [s], message); a recorder stamps a little later than the driver."""
    bag = Writer(path, version=8, storage_plugin=storage)
    bag.set_compression(compression, CompressionFormat.ZSTD)
    with bag:
        there = {}
        for topic, time_s, message in messages:
            if topic not in there:
                there[topic] = bag.add_connection(topic, message.__msgtype__, typestore=STORE)
            bag.write(there[topic], round(time_s * 1e9) + 3_000_000, STORE.serialize_cdr(message, message.__msgtype__))
    return path


def images(colour=COLOUR, depth=DEPTH):
    """Colour a hundredth of a second later than depth, at 20 depth images without colour less."""
    said = []
    for one in seen():
        t = one.time_s + 100.0
        said.append((depth, t, image(t, np.rint(1000.0 * one.depth_m).astype(np.uint16), "16UC1")))
        said.append((depth.replace("image_raw", "camera_info"), t, calibration(t)))
        if one.step != 3:
            said.append((colour, t + 0.01, image(t + 0.01, one.rgb[..., ::-1] + np.uint8(one.step), "bgr8")))
    return said


def poses_by_tf():
    """Half a tenth of a second before and after each image: in between there is something to interpolate."""
    said = [("/tf_static", 99.0, tf(99.0, "base", "optical", T_BASE_CAMERA))]
    for one in seen():
        for shift in (-0.05, 0.0, 0.05):
            t = one.time_s + 100.0 + shift
            said.append(("/tf", t, tf(t, "odom", "base", base_of(one))))
    return said


def check(sequence, steps=(0, 1, 2, 4, 5), atol=1e-6):
    frames = list(sequence.observations())
    assert len(frames) == len(steps)
    for found, step in zip(frames, steps, strict=True):
        made = seen()[step]
        np.testing.assert_allclose(found.T_world_camera, made.T_world_camera, atol=atol)
        np.testing.assert_allclose(found.depth_m, made.depth_m, atol=0.0006)
        assert found.rgb.shape == (48, 64, 3)
        np.testing.assert_array_equal(found.rgb, made.rgb[..., ::-1] + np.uint8(step))
        assert found.time_s == pytest.approx(made.time_s, abs=1e-6)
    camera = frames[0].intrinsics
    np.testing.assert_allclose([camera.fx, camera.fy, camera.cx, camera.cy],
                               [CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy])  # fmt: skip


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_images_calibration_and_frames(tmp_path, storage):
    path = write_bag(tmp_path / "bag", images() + poses_by_tf(), storage)
    sequence, layout = open_sequence(path, SequenceOptions(floor_m=0.0))
    assert layout == "rosbag"
    check(sequence)
    if storage is StoragePlugin.MCAP:
        (file,) = path.glob("*.mcap")
        check(open_sequence(file, SequenceOptions(floor_m=0.0))[0])


def test_the_floor_is_found(tmp_path):
    path = write_bag(tmp_path / "bag", images() + poses_by_tf())
    assert find_floor_m(open_sequence(path)[0]) == pytest.approx(0.0, abs=0.02)


def test_odometry_and_the_place_of_the_camera_on_the_robot(tmp_path):
    said = images() + [("/odom", one.time_s + 100.0, odometry(one.time_s + 100.0, base_of(one))) for one in seen()]
    fixed = ("/tf_static", 99.0, tf(99.0, "base", "optical", T_BASE_CAMERA))
    check(open_sequence(write_bag(tmp_path / "bag", [*said, fixed]), SequenceOptions(floor_m=0.0))[0])
    with pytest.raises(RunFolderError, match="record /tf_static"):
        open_sequence(write_bag(tmp_path / "lost", said))


def test_poses_of_the_camera_itself_and_topics_that_are_named(tmp_path):
    said = images() + [
        ("/vio", one.time_s + 100.0, camera_pose(one.time_s + 100.0, one.T_world_camera)) for one in seen()
    ]
    said += [("/slam", one.time_s + 100.0, camera_pose(one.time_s + 100.0, np.eye(4))) for one in seen()]
    path = write_bag(tmp_path / "bag", said)
    with pytest.raises(RunFolderError, match="--topic pose=/slam"):
        open_sequence(path)
    check(open_sequence(path, SequenceOptions(floor_m=0.0, topics={"pose": "/vio"}))[0])
    with pytest.raises(RunFolderError, match="no topic '/gps' for pose; pose could be /slam, /vio"):
        open_sequence(path, SequenceOptions(topics={"pose": "/gps"}))
    with pytest.raises(RunFolderError, match="There is no role 'color'"):
        open_sequence(path, SequenceOptions(topics={"color": "/vio"}))


def test_metres_in_floats_and_compressed_images(tmp_path):
    said = poses_by_tf()
    for one in seen():
        t, buffer = one.time_s + 100.0, io.BytesIO()
        Image.fromarray(one.rgb[..., ::-1] + np.uint8(one.step)).save(buffer, "PNG")
        said.append((COLOUR + "/compressed", t, compressed(t, buffer.getvalue(), "bgr8; png compressed bgr8")))
        said.append((DEPTH, t, image(t, one.depth_m.astype(np.float32), "32FC1", big=True)))
        said.append((DEPTH.replace("image_raw", "camera_info"), t, calibration(t)))
    path = write_bag(tmp_path / "bag", said)
    check(open_sequence(path, SequenceOptions(floor_m=0.0))[0], steps=range(6))


@pytest.mark.parametrize("kind", ["16UC1", "32FC1"])
def test_compressed_depth(tmp_path, kind):
    said = [entry for entry in images() if entry[0] != DEPTH] + poses_by_tf()
    a, b = 120.0, -1.5
    for one in seen():
        t, buffer = one.time_s + 100.0, io.BytesIO()
        steps = 1000.0 * one.depth_m if kind == "16UC1" else a / one.depth_m + b
        Image.fromarray(np.rint(steps).astype(np.uint16)).save(buffer, "PNG")
        data = struct.pack("<iff", 0, a, b) + buffer.getvalue()
        said.append((DEPTH + "/compressedDepth", t, compressed(t, data, f"{kind}; compressedDepth png")))
    frames = list(open_sequence(write_bag(tmp_path / "bag", said), SequenceOptions(floor_m=0.0))[0].observations())
    for found, step in zip(frames, (0, 1, 2, 4, 5), strict=True):
        tolerance = 0.0006 if kind == "16UC1" else 0.6 / a * seen()[step].depth_m.max() ** 2
        np.testing.assert_allclose(found.depth_m, seen()[step].depth_m, atol=tolerance)


def write_bag_of_ros_1(path, compression=None):
    """Write the same walk as a bag of ROS 1."""
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    bag = Writer1(path)
    if compression is not None:
        bag.set_compression(compression)
    with bag:
        there = {}

        def write(topic, time_s, message):
            if topic not in there:
                there[topic] = bag.add_connection(topic, message.__msgtype__, typestore=store)
            bag.write(there[topic], round(time_s * 1e9), store.serialize_ros1(message, message.__msgtype__))

        write("/tf_static", 99.0, tf(99.0, "base", "optical", T_BASE_CAMERA, store))
        for one in seen():
            t = one.time_s + 100.0
            write("/tf", t, tf(t, "odom", "base", base_of(one), store))
            write(DEPTH, t, image(t, np.rint(1000.0 * one.depth_m).astype(np.uint16), "16UC1", store))
            write(COLOUR, t, image(t, one.rgb[..., ::-1] + np.uint8(one.step), "bgr8", store))
            write("/camera/color/camera_info", t, calibration(t, store))
    return path


@pytest.mark.parametrize("compression", [None, Writer1.CompressionFormat.LZ4, Writer1.CompressionFormat.BZ2])
def test_a_bag_of_ros_1(tmp_path, compression):
    write_bag_of_ros_1(tmp_path / "walk.bag", compression)
    check(open_sequence(tmp_path / "walk.bag", SequenceOptions(floor_m=0.0))[0], steps=range(6))


def test_what_a_bag_lacks_is_one_sentence(tmp_path, capsys):
    told = {
        "colour": ([entry for entry in images() if entry[0] != COLOUR], "no topic for colour; its topics are"),
        "camera": ([e for e in images() if "info" not in e[0]] + poses_by_tf(), "no topic for camera"),
        "pose": (images(), "no topic for pose"),
        "two": (images() + images(colour="/rear/image_raw")[1:], "several topics for colour"),
    }
    for name, (said, words) in told.items():
        assert main(["map", str(write_bag(tmp_path / name, said)), "--out", str(tmp_path / "run")]) == 2
        assert words in " ".join(capsys.readouterr().err.split())
    (tmp_path / "damaged.mcap").write_bytes(b"\x89MCAP0\r\n nothing")
    assert main(["map", str(tmp_path / "damaged.mcap"), "--out", str(tmp_path / "run")]) == 2
    assert "damaged.mcap cannot be read as a recording" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "run").exists()


def test_poses_in_between():
    track = Track("poses")
    for time_s, yaw in ((1.0, 0.4), (1.2, 0.8)):
        quaternion = Rotation.from_euler("z", yaw).as_quat()
        track.add(time_s, np.array([time_s, 0.0, 0.0]), quaternion)
    T = track.at(1.05)
    assert T is not None
    assert T[0, 3] == pytest.approx(1.05)
    assert math.atan2(T[1, 0], T[0, 0]) == pytest.approx(0.5)
    assert track.at(0.4) is None
    assert track.at(1.8) is None
    track.add(9.0, np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
    assert track.at(5.0) is None


@pytest.mark.parametrize("kind", ["message", "file", "mcap", "lz4", "bz2"])
def test_what_unpacks_to_too_much_is_refused(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(bag_limits, "MAX_PART_BYTES", 1000)
    monkeypatch.setattr(bag_limits, "MAX_RATIO", 1)
    if kind in ("lz4", "bz2"):
        path = write_bag_of_ros_1(tmp_path / "walk.bag", Writer1.CompressionFormat[kind.upper()])
    else:
        mode = {"message": "MESSAGE", "file": "FILE", "mcap": "STORAGE"}[kind]
        storage = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        path = write_bag(tmp_path / "walk", images() + poses_by_tf(), storage, CompressionMode[mode])
    with pytest.raises(RunFolderError, match="unpacks to more than 0 MiB"):
        open_sequence(path, SequenceOptions(floor_m=0.0))


@pytest.mark.parametrize("mode", ["MESSAGE", "FILE", "STORAGE"])
def test_compressed_bags_of_ros_2(tmp_path, mode):
    storage = StoragePlugin.MCAP if mode == "STORAGE" else StoragePlugin.SQLITE3
    path = write_bag(tmp_path / "walk", images() + poses_by_tf(), storage, CompressionMode[mode])
    check(open_sequence(path, SequenceOptions(floor_m=0.0))[0])


INFO = DEPTH.replace("image_raw", "camera_info")


def changed(topic, change, said=None):
    """Messages, with those of a topic as ``change`` of message and number makes them."""
    numbers = iter(range(1000))
    said = images() + poses_by_tf() if said is None else said
    return [(name, t, change(message, next(numbers)) if name == topic else message) for name, t, message in said]


def moved_by(message, x=0.0, w=None):
    """A pose in tf with another place and quaternion."""
    (one,) = message.transforms
    xyz = make("geometry_msgs/msg/Vector3", x=x, y=0.0, z=0.0)
    rotation = one.transform.rotation if w is None else make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=w)
    return replace(
        message, transforms=[replace(one, transform=replace(one.transform, translation=xyz, rotation=rotation))]
    )


REGION = make("sensor_msgs/msg/RegionOfInterest", x_offset=9, y_offset=9, height=20, width=20, do_rectify=False)


@pytest.mark.parametrize(
    ("topic", "change", "words"),
    [
        (INFO, lambda m, k: replace(m, k=m.k * (1.0 + k)), "changes in the course of the bag"),
        (INFO, lambda m, k: replace(m, roi=REGION), "a region of 20 x 20 pixels of 64 x 48"),
        (INFO, lambda m, k: replace(m, width=640, height=100), "64 x 48 pixels, which is none of a camera"),
        (COLOUR, lambda m, k: replace(m, encoding="mono8"), "64 pixels of 'mono8' have 64: the encoding is"),
        (COLOUR, lambda m, k: replace(m, encoding="odd") if k else m, "'odd' is no colour"),
        (DEPTH, lambda m, k: replace(m, encoding="odd") if k else m, "'odd' is no depth"),
        (DEPTH, lambda m, k: replace(m, width=0, height=0, step=0), "it has 0 x 0 pixels"),
        (DEPTH, lambda m, k: replace(m, header=header(100.0 + 0.1 * k, f"f{k}")), r"of several frames \('f0', 'f1'"),
    ],
)  # fmt: skip
def test_messages_that_do_not_fit_each_other_are_refused(tmp_path, topic, change, words):
    path = write_bag(tmp_path / "bag", changed(topic, change))
    with pytest.raises(RunFolderError, match=words):
        list(open_sequence(path, SequenceOptions(floor_m=0.0))[0].observations())


@pytest.mark.parametrize("lacks", ["no calibration", "zeros"])
def test_a_camera_that_the_user_gives_stands_for_the_calibration(tmp_path, lacks):
    said = changed(INFO, lambda m, k: replace(m, k=np.zeros(9)))
    path = write_bag(tmp_path / "bag", [one for one in said if lacks == "zeros" or one[0] != INFO])
    camera = (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    check(open_sequence(path, SequenceOptions(floor_m=0.0, camera=camera))[0])


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ([("/tf", 100.0, tf(100.0, "map", "base", np.eye(4)))], "'base' stands in several: 'odom', 'map'"),
        ([("/tf", 100.0, tf(100.0, "optical", "odom", np.eye(4)))], "the frames go round in a circle"),
    ],
)
def test_frames_that_are_no_tree_are_refused(tmp_path, said, words):
    with pytest.raises(RunFolderError, match=words):
        open_sequence(write_bag(tmp_path / "bag", images() + poses_by_tf() + said))


def test_an_odometry_of_no_frame_or_of_several_is_refused(tmp_path):
    fixed = ("/tf_static", 99.0, tf(99.0, "base", "optical", T_BASE_CAMERA))
    for name, frame_of, words in (
        ("none", lambda step: "", "does not say of which frame"),
        ("several", lambda step: "base" if step else "optical", "tells of several: 'base', 'optical'"),
    ):
        told = [
            replace(odometry(one.time_s + 100.0, base_of(one)), child_frame_id=frame_of(one.step)) for one in seen()
        ]
        said = [("/odom", 100.0 + 0.1 * step, message) for step, message in enumerate(told)]
        with pytest.raises(RunFolderError, match=words):
            open_sequence(write_bag(tmp_path / name, [*images(), fixed, *said]))


@pytest.mark.parametrize("wrong", [{"w": 0.0}, {"w": 2.0}, {"w": math.nan}, {"x": math.nan}, {"x": 1e30}])
def test_poses_that_are_none_are_left_out(tmp_path, caplog, wrong):
    # The seventh lies half a tenth of a second before a frame.
    said = changed("/tf", lambda m, k: moved_by(m, **wrong) if k == 6 else m)
    check(open_sequence(write_bag(tmp_path / "bag", said), SequenceOptions(floor_m=0.0))[0])
    assert "1 of 18 poses of the frame 'base' are left out" in caplog.text


def test_frames_that_are_left_out_are_counted(tmp_path, caplog):
    early = [one for one in poses_by_tf() if one[1] < 100.25]
    twice = [(name, t + 50.0, message) for name, t, message in images() if name == DEPTH]
    sequence, _ = open_sequence(write_bag(tmp_path / "bag", images() + early + twice), SequenceOptions(floor_m=0.0))
    for words in (
        "6 of 12 frames are left out, because their depth has the time of another one",
        "1 of 6 frames are left out, because no colour is within 0.02 s",
        f"{5 - len(sequence)} of 5 frames are left out, because no pose of the camera is known",
    ):
        assert words in caplog.text


def test_images_that_were_recorded_at_one_time_are_told_apart(tmp_path):
    path = write_bag(tmp_path / "bag", images() + poses_by_tf())
    (file,) = path.glob("*.db3")
    with sqlite3.connect(file) as base:
        base.execute("UPDATE messages SET timestamp = 7")
    base.close()
    check(open_sequence(path, SequenceOptions(floor_m=0.0))[0])


def test_distortion_and_depth_of_another_camera_are_said(tmp_path, caplog):
    bent = changed(INFO, lambda m, k: replace(m, d=np.full(5, 0.1)))
    said = changed(COLOUR, lambda m, k: replace(m, header=replace(m.header, frame_id="other")), bent)
    open_sequence(write_bag(tmp_path / "bag", said))
    assert "the distortion in /camera/aligned_depth_to_color/camera_info is left out" in caplog.text
    assert "depth is of the frame 'optical' and colour of 'other'" in caplog.text


def test_depth_beyond_everything_is_none(tmp_path):
    def far(message, k):
        depth_m = seen()[k].depth_m.copy()
        depth_m[0] = 1e30
        return image(100.0 + seen()[k].time_s, depth_m.astype(np.float32), "32FC1")

    sequence, _ = open_sequence(write_bag(tmp_path / "bag", changed(DEPTH, far)))
    assert np.isnan(next(sequence.observations()).depth_m[0]).all()


def test_a_unit_that_lifts_the_cameras_is_said(tmp_path, caplog):
    path = write_bag(tmp_path / "bag", images() + poses_by_tf())
    open_sequence(path)
    assert "above the floor" not in caplog.text
    open_sequence(path, SequenceOptions(depth_unit_m=1.0))
    assert "m above the floor: check the unit of depth" in caplog.text


@pytest.mark.parametrize(("kind", "fits"), [("uint16", True), ("uint8", False)])
def test_depth_in_a_plain_png_has_16_bits(tmp_path, kind, fits):
    said = [entry for entry in images() if entry[0] != DEPTH] + poses_by_tf()
    for one in seen():
        buffer = io.BytesIO()
        Image.fromarray(np.rint(1000.0 * one.depth_m).astype(kind)).save(buffer, "PNG")
        t = one.time_s + 100.0
        said.append((DEPTH + "/compressed", t, compressed(t, buffer.getvalue(), "16UC1; png compressed ")))
    sequence, _ = open_sequence(write_bag(tmp_path / "bag", said), SequenceOptions(floor_m=0.0))
    if fits:
        check(sequence)
    else:
        with pytest.raises(RunFolderError, match="its pixels are L, not one number of 16 bits each"):
            list(sequence.observations())
