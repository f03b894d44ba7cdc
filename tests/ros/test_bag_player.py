"""A recording that is played gives the same topics with the same messages, in the time in which it was made."""

import time
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import get_types_from_msg

from anm_mj.cli.main import main
from anm_mj.errors import RunFolderError
from anm_mj.io.ros_messages import RosMessages
from anm_mj.ros.bag_player import play
from anm_mj.ros.names import IMAGE, ODOMETRY_TYPE, TF_TYPE
from anm_mj.ros.node import FRAMES, STATE, Node
from anm_mj.types import Pose2
from tests.ros.conftest import wait_until

LASTS_S = 0.5


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    make, depth_m = RosMessages(), np.full((4, 6), 1.5, np.float32)
    with Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        kinds = {"/odom": ODOMETRY_TYPE, "/depth": IMAGE, "/tf_static": TF_TYPE}
        to = {topic: writer.add_connection(topic, kind, typestore=make.store) for topic, kind in kinds.items()}

        def write(topic: str, at_s: float, message: object) -> None:
            writer.write(to[topic], round(at_s * 1e9), make.to_cdr(message))

        for child in ("camera", "laser"):
            write("/tf_static", 10.0, make.transforms(10.0, [("base_link", child, np.eye(4))]))
        for at_s in (10.0, 10.0 + LASTS_S):
            write("/odom", at_s, make.odometry(at_s, "odom", "base_link", Pose2(at_s, 0.0, 0.0)))
            write("/depth", at_s, make.image(at_s, "camera", depth_m))
    return tmp_path / "bag"


def test_the_same_topics_come_with_the_same_messages_in_the_same_time(bag: Path, node: Node, other: Node):
    heard: dict[str, list] = {"/odom": [], "/depth": [], "/tf_static": []}
    at_s = []
    for topic, kind in (("/odom", ODOMETRY_TYPE), ("/depth", IMAGE)):
        other.subscribe(topic, kind, lambda message, _, topic=topic: heard[topic].append(message), STATE)
    other.subscribe("/odom", ODOMETRY_TYPE, lambda *_: at_s.append(time.monotonic()), STATE)

    def come_late() -> bool:
        # The frames are latched.
        if at_s and not late:
            late.append(True)
            other.subscribe("/tf_static", TF_TYPE, lambda message, _: heard["/tf_static"].append(message), FRAMES)
        return False

    # On a busy machine, nodes that do not know each other yet need longer than topics are announced before.
    greeting, known = node.publisher("/greeting", TF_TYPE, FRAMES), []
    greeting.publish(RosMessages().transforms(0.0, []))
    other.subscribe("/greeting", TF_TYPE, lambda *_: known.append(True), FRAMES)
    wait_until(lambda: known, 30.0)
    late: list[bool] = []
    assert play(bag, node, rate=0.5, until=come_late) == 6

    wait_until(lambda: [len(messages) for messages in heard.values()] == [2, 2, 2], 30.0)
    assert [message.pose.pose.position.x for message in heard["/odom"]] == [10.0, 10.0 + LASTS_S]
    assert heard["/depth"][0].data.view("<f4").tolist() == [1.5] * 24
    # A robot has several publishers of static frames, each of some.
    assert [message.transforms[0].child_frame_id for message in heard["/tf_static"]] == ["camera", "laser"]
    assert at_s[-1] - at_s[0] > LASTS_S


def test_a_recording_ends_where_it_is_told_to(bag: Path, node: Node):
    assert play(bag, node, duration_s=0.5 * LASTS_S) == 4


def test_what_is_no_recording_is_told(tmp_path: Path, node: Node):
    (tmp_path / "x.mcap").write_bytes(b"no bag")
    with pytest.raises(RunFolderError, match="cannot be read as a recording"):
        play(tmp_path / "x.mcap", node)


def test_a_recording_of_unknown_types_alone_says_nothing(tmp_path: Path, node: Node, caplog):
    store, kind = RosMessages().store, "my_msgs/msg/Level"
    store.register(get_types_from_msg("float64 percent\n", kind))
    with Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        battery = writer.add_connection("/battery", kind, typestore=store)
        writer.write(battery, 10**9, store.serialize_cdr(store.types[kind](percent=80.0), kind))
    assert play(tmp_path / "bag", node) == 0
    assert "/battery is left out: its type my_msgs/msg/Level is not known." in caplog.text


def test_a_recording_that_is_damaged_in_the_middle_is_one_sentence(tmp_path: Path, node: Node):
    make = RosMessages()
    writer = Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        depth = writer.add_connection("/depth", IMAGE, typestore=make.store)
        for k in range(40):
            noise = np.random.default_rng(k).integers(0, 9, (64, 64, 3)).astype(np.uint8)
            writer.write(depth, 10**9 + k, make.to_cdr(make.image(1.0, "camera", noise)))
    (file,) = (tmp_path / "bag").glob("*.mcap")
    content = bytearray(file.read_bytes())
    content[20_000:20_100] = bytes(100)
    file.write_bytes(content)
    with pytest.raises(RunFolderError, match="cannot be read as a recording"):
        play(tmp_path / "bag", node)


@pytest.mark.parametrize("rate", ["0", "-1", "nan"])
def test_a_rate_that_no_recording_can_be_played_at_is_one_sentence(bag, capsys, rate):
    assert main(["simulate", str(bag), "--ros", f"--rate={rate}"]) == 2
    assert "give a number from 0.01 to 100" in capsys.readouterr().err


@pytest.mark.parametrize(
    "option",
    [
        ["--sensor", "d435i"],
        ["--set", "model.wheel_noise=0.02"],
        ["--image-hz", "10"],
        ["--robot", "diff_drive"],
        ["--seed", "0"],
    ],
)
def test_a_recording_has_no_options_of_a_robot(bag, capsys, option):
    assert main(["simulate", str(bag), "--ros", *option]) == 2
    assert f"{option[0]} is {option[1].removesuffix('.0')}" in capsys.readouterr().err


@pytest.mark.parametrize("duration", ["0", "-1", "nan"])
def test_a_duration_that_is_none_is_one_sentence(bag, capsys, duration):
    assert main(["simulate", str(bag), "--ros", f"--duration={duration}"]) == 2
    assert "give a number of seconds above 0" in capsys.readouterr().err


def test_playing_ends_also_where_the_recording_pauses(bag: Path, node: Node):
    begin = time.monotonic()
    # Half a second was recorded, which takes 50 s.
    assert play(bag, node, rate=0.01, until=lambda: time.monotonic() - begin > 4.0) == 4
    assert time.monotonic() - begin < 20.0
