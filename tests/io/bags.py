"""Bags as drivers publish them, written by the package rosbags."""

import math

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

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


def calibration(time_s, store=STORE, camera=CAMERA):
    region = make(
        "sensor_msgs/msg/RegionOfInterest", store, x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    k = np.array([camera.fx, 0.0, camera.cx - 0.5, 0.0, camera.fy, camera.cy - 0.5, 0.0, 0.0, 1.0])
    named = {"d": np.zeros(5), "k": k, "r": np.eye(3).ravel(), "p": np.zeros(12)}
    if store is not STORE:
        named = {name.upper(): value for name, value in named.items()}
    return make("sensor_msgs/msg/CameraInfo", store, header=header(time_s, "optical", store), height=camera.height,
                width=camera.width, distortion_model="plumb_bob", binning_x=0, binning_y=0, roi=region,
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
        # As stamped: a reference of another tool has the same clock.
        assert found.time_s == pytest.approx(made.time_s + 100.0, abs=1e-6)
    camera = frames[0].intrinsics
    np.testing.assert_allclose([camera.fx, camera.fy, camera.cx, camera.cy],
                               [CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy])  # fmt: skip


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


def changed(topic, change, said=None):
    """Messages, with those of a topic as ``change`` of message and number makes them."""
    numbers = iter(range(1000))
    said = images() + poses_by_tf() if said is None else said
    return [(name, t, change(message, next(numbers)) if name == topic else message) for name, t, message in said]
