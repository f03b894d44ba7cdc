"""Images of a live robot that cannot be used."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from anm_mj.io.ros_messages import RosMessages
from anm_mj.ros.health import Health
from anm_mj.ros.names import COMPRESSED
from anm_mj.ros.rgbd_intake import RgbdIntake
from anm_mj.types import Intrinsics

MAKE = RosMessages()
DEPTH_M = np.full((48, 64), 2.0, np.float32)


@pytest.fixture
def health() -> Health:
    return Health(0.2)


@pytest.fixture
def intake(health: Health) -> RgbdIntake:
    made = RgbdIntake(health, 0.001, 0.02)
    made.colour, made.depth, made.camera = "/colour", "/depth", "/camera_info"
    made.hear_camera(MAKE.camera_info(0.0, "camera", Intrinsics(64, 48, 50.0, 50.0, 32.0, 24.0)))
    return made


def jpeg(time_s, rows=48, cols=64, cut=None):
    file = io.BytesIO()
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (rows, cols, 3), np.uint8)).save(file, "jpeg")
    data = np.frombuffer(file.getvalue()[:cut], np.uint8)
    return MAKE.make(COMPRESSED, header=MAKE.header(time_s, "camera"), format="rgb8; jpeg compressed bgr8", data=data)


def raw(time_s):
    return MAKE.image(time_s, "camera", np.zeros((48, 64, 3), np.uint8))


def look(intake, time_s, colour):
    """Whether it gives the images of a time."""
    intake.hear_depth(MAKE.image(time_s, "camera", DEPTH_M))
    intake.hear_colour(colour)
    seen = intake.wait_newer(time_s, 0.0)
    return seen is not None and seen.time_s == time_s


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        (jpeg(2.0, cut=900), "/colour: image file is truncated"),
        (replace(raw(2.0), step=5), "/colour: 9216 bytes are not 48 rows of 5"),
        (jpeg(2.0, 24, 32), "/colour: it gives 32 x 24 pixels after images of 64 x 48; colour and depth must keep one"),
    ],
    ids=["truncated", "step", "size"],
)
def test_colour_that_cannot_be_used_is_a_fault_and_costs_its_pair(intake, health, bad, said):
    assert not look(intake, 2.0, bad)
    assert str(health.present()).startswith(said)
    assert intake.wait_newer(-np.inf, 0.0) is None
    assert look(intake, 2.1, jpeg(2.1))

    assert not look(intake, 2.2, replace(bad, header=MAKE.header(2.2, "camera")))
    # The last view is seen again where the run ends, and the bad one is not taken up once more.
    intake.hear_depth(MAKE.image(2.3, "camera", DEPTH_M))
    assert intake.wait_newer(-np.inf, 0.0).time_s == 2.1
    assert intake.latest_s == 2.2


def test_depth_that_comes_before_its_colour_waits_for_it(intake):
    for number in range(20):
        time_s = 2.0 + number / 60.0
        colour = np.full((48, 64, 3), number, np.uint8)
        intake.hear_depth(MAKE.image(time_s, "camera", DEPTH_M))
        intake.hear_colour(MAKE.image(time_s, "camera", colour))
        seen = intake.wait_newer(-np.inf, 0.0)
        # One image does not tell when the next one comes.
        if number > 1:
            assert seen.time_s == pytest.approx(time_s)
            assert seen.rgb[0, 0, 0] == number


def test_depth_between_two_colours_waits_for_the_second_only_where_that_is_nearer(intake):
    for late_s, waits in ((0.005, False), (0.012, True)):
        for number in range(3):
            intake.hear_colour(raw(5.0 + late_s + number / 60.0))
        time_s = 5.0 + 2.0 * late_s + 2.0 / 60.0
        intake.hear_depth(MAKE.image(time_s, "camera", DEPTH_M))
        assert (intake.latest_s == pytest.approx(time_s)) != waits
        intake.hear_colour(raw(5.0 + late_s + 3.0 / 60.0))
        assert intake.latest_s == pytest.approx(time_s)
