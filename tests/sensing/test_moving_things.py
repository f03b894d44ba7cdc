"""Things that move, followed from frame to frame, and when the robot waits for them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.planning.steps_ahead import held_disc, in_the_way
from anm_mj.sensing.moving_things import MovingThing, MovingThings
from anm_mj.sensing.pixel_state import without_moved
from anm_mj.types import Footprint, Pose2
from tests.box_room import observe

BODY = Footprint(0.18, 0.05, 1.35)


def frame(time_s: float, *cols: int):
    """A frame in which things 1.5 m away moved, each twenty columns wide."""
    seen = observe(0, Pose2(0.0, 0.0, 0.0))
    moved = np.zeros(seen.depth_m.shape, bool)
    for col in cols:
        moved[100:160, col : col + 20] = True
    depth_m = np.where(moved, np.float32(1.5), seen.depth_m)
    return replace(without_moved(replace(seen, depth_m=depth_m), moved), time_s=time_s)


def test_a_thing_gets_a_place_and_a_velocity():
    things = MovingThings()
    for k in range(6):
        things.update(frame(0.5 * k, 60 + 16 * k))

    (thing,) = things.things
    # Sixteen pixels to the right at 1.5 m in half a second, focal length 128 px.
    assert thing.velocity_mps[1] == pytest.approx(-16 / 128 * 1.5 / 0.5, rel=0.1)
    assert abs(thing.velocity_mps[0]) < 0.01
    assert thing.after(2.5)[1] == pytest.approx(-(150 - 128) / 128 * 1.5, abs=0.02)


def test_a_thing_in_a_late_image_was_there_when_the_image_was_taken():
    things = MovingThings()
    for k in range(6):
        things.update(replace(frame(0.5 * k, 60 + 16 * k), image_age_s=0.2))

    (thing,) = things.things
    assert thing.seen_s == pytest.approx(2.3)
    # By now it has gone on, to the right.
    assert thing.after(2.5)[1] == pytest.approx(thing.y_m + 0.2 * thing.velocity_mps[1])
    assert thing.velocity_mps[1] < -0.3


def test_two_things_stay_apart_and_are_forgotten_after_a_while():
    things = MovingThings()
    things.update(frame(0.0, 40, 180))
    things.update(frame(0.4, 44, 176))
    assert len(things.things) == 2

    things.update(frame(1.0))
    assert len(things.things) == 2
    things.update(frame(3.0))
    assert not things.things


@pytest.mark.parametrize(
    ("x_m", "y_m", "velocity", "waits"),
    [
        (0.6, 0.0, (0.0, 0.0), True),  # stands ahead, near
        (0.7, 0.0, (0.0, 0.0), False),  # stands ahead, less near
        (0.5, 0.3, (0.0, 0.0), True),  # leaves too little room
        (0.6, 0.55, (0.0, 0.0), False),  # leaves room to pass
        (1.5, 0.0, (0.0, 0.0), False),  # stands ahead, far
        (1.5, 0.0, (-1.0, 0.0), True),  # comes
        (0.7, 1.0, (0.0, -1.0), True),  # steps into the way
        (0.3, 1.0, (0.0, 0.0), False),  # beside
        (-0.6, 0.0, (0.0, 0.0), False),  # behind
        (0.9, 0.0, (1.0, 0.0), False),  # goes ahead of the robot
    ],
)
def test_the_robot_waits_for_what_is_or_comes_in_its_way(x_m, y_m, velocity, waits):
    thing = MovingThing(x_m, y_m, velocity, 0.25, 0.0)

    assert (in_the_way([thing], BODY, Pose2(0.0, 0.0, 0.0), 0.0) is thing) is waits
    # The same turned by a quarter.
    turned = MovingThing(-y_m, x_m, (-velocity[1], velocity[0]), 0.25, 0.0)
    assert (in_the_way([turned], BODY, Pose2(0.0, 0.0, math.pi / 2), 0.0) is turned) is waits


def test_paths_keep_off_the_disc_of_a_thing_which_leaves_room_for_the_robot():
    far, near = (MovingThing(0.0, x_m, (0.0, 0.0), 0.25, 0.0) for x_m in (2.0, 0.4))

    assert held_disc(far, BODY, Pose2(0.0, 0.0, 0.0), 0.0) == pytest.approx((0.0, 2.0, 0.32))
    assert held_disc(near, BODY, Pose2(0.0, 0.0, 0.0), 0.0) == pytest.approx((0.0, 0.4, 0.15))


def seen_from(x_m: float, time_s: float, *, low: bool | None = None):
    """A frame from a place on the way to a thing at x = 1.5 m, which is low or not, or not seen."""
    seen = observe(0, Pose2(x_m, 0.0, 0.0))
    camera, height_m = seen.intrinsics, float(seen.T_world_camera[2, 3])
    top_m = 0.12 if low else height_m + 0.2
    rows = np.arange(camera.height) + 0.5
    z_m = height_m - (rows - camera.cy) / camera.fy * 1.5
    moved = np.zeros(seen.depth_m.shape, bool)
    if low is not None:
        moved[(z_m < top_m) & (z_m > 0.0), 118:138] = True
    return replace(
        without_moved(replace(seen, depth_m=np.where(moved, np.float32(1.5), seen.depth_m)), moved), time_s=time_s
    )


@pytest.mark.parametrize(
    ("low", "x_m", "time_s", "remembered"),
    [
        (True, 1.0, 10.0, True),  # the camera looks over it
        (True, 1.0, 30.0, False),  # for too long
        (True, 0.0, 10.0, False),  # its place is in view, and empty
        (True, 0.0, 1.5, True),  # it may be hidden for a moment
        (False, 1.0, 10.0, False),  # the camera would see it
    ],
)
def test_what_the_camera_looks_over_is_remembered_until_its_place_is_seen(low, x_m, time_s, remembered):
    things = MovingThings()
    for before_s in (0.6, 0.3, 0.0):
        things.update(seen_from(0.0, -before_s, low=low))
    assert [thing.is_low for thing in things.things] == [low]

    things.update(seen_from(x_m, time_s))
    assert len(things.things) == remembered


def test_feet_alone_are_no_low_thing():
    things = MovingThings()
    for number, low in enumerate((True, True, False, True, True)):
        things.update(seen_from(0.0, 0.3 * number, low=low))
        assert [thing.is_low for thing in things.things] == [False]


@pytest.mark.parametrize(("depth_m", "remembered"), [(math.nan, True), (1.0, True), (1.6, False), (math.inf, False)])
def test_a_low_thing_is_forgotten_only_where_the_camera_sees_past_its_place(depth_m, remembered):
    """Its place is in the image, where nothing was measured, or what hides it, or what lies behind."""
    things = MovingThings()
    for before_s in (0.6, 0.3, 0.0):
        things.update(seen_from(0.0, -before_s, low=True))

    after = seen_from(0.0, 10.0)
    things.update(replace(after, depth_m=np.full_like(after.depth_m, depth_m)))
    assert len(things.things) == remembered


def test_a_low_thing_out_of_sight_needs_more_room_the_longer_it_is_hidden():
    low = MovingThing(1.0, 0.0, (0.0, 0.0), 0.2, 0.0, low_sights=3, fastest_mps=0.3)

    assert [low.spread_m(time_s) for time_s in (0.0, 0.5, 5.0)] == pytest.approx([0.0, 0.15, 0.3])
    assert replace(low, low_sights=2).spread_m(5.0) == 0.0
    assert in_the_way([low], BODY, Pose2(0.3, 0.0, 0.0), 0.0) is None
    assert in_the_way([low], BODY, Pose2(0.3, 0.0, 0.0), 5.0) is low
