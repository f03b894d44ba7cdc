"""What stops a live robot, and when, by a clock that the test sets."""

import itertools
from contextlib import closing
from unittest.mock import Mock

import pytest

from anm_mj.ros import commander
from anm_mj.ros.drive_config import RosConfig
from anm_mj.ros.health import Health
from anm_mj.ros.node import Node
from tests.ros.conftest import wait_until

TIMEOUT_S = 0.25
ODOMETRY, DEPTH = "the odometry on /odom", "the depth on /depth"


class Clock:
    now_s = 50.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def health(clock: Clock) -> Health:
    made = Health(TIMEOUT_S, clock)
    for source in (ODOMETRY, DEPTH):
        made.expect(source)
        made.hear(source, 7.0)
    return made


def test_nothing_is_wrong_while_all_sources_go_on(health: Health, clock: Clock):
    for _ in range(30):
        clock.now_s += 0.1
        for source in (ODOMETRY, DEPTH):
            health.hear(source, 7.0 + clock.now_s - 50.0)
        assert health.present() is None


@pytest.mark.parametrize("stamp_s", [None, 7.1], ids=["silent", "the same stamp again and again"])
def test_a_source_that_does_not_go_on_is_a_fault(health: Health, clock: Clock, stamp_s):
    """Of one that repeats itself after half the timeout, of a silent one after all of it."""
    found = []
    for step in range(1, 6):
        clock.now_s += 0.1
        health.hear(ODOMETRY, 7.0 + 0.1 * step)
        if stamp_s is not None:
            health.hear(DEPTH, stamp_s)
        found.append(health.present())
    silent, again = f"nothing was heard of {DEPTH} for 0.25 s", f"{DEPTH} says the same again and again"
    assert found == ([None] * 2 + [silent] * 3 if stamp_s is None else [None] * 2 + [again] + [silent] * 2)

    health.hear(DEPTH, 7.4)
    assert health.present() is None


@pytest.mark.parametrize(("jump_s", "is_fault"), [(30.0, True), (-0.5, True), (1.05, False), (0.02, False)])
def test_a_clock_that_jumps_is_a_fault_for_half_a_second(health: Health, clock: Clock, jump_s, is_fault):
    clock.now_s += 0.1
    for source in (ODOMETRY, DEPTH):
        health.hear(source, 7.0 + jump_s)

    assert (health.present() is not None) == is_fault
    if is_fault:
        assert health.present() == f"the clock of {ODOMETRY} jumped by {jump_s:+.2f} s"
        clock.now_s += 0.5
        for source in (ODOMETRY, DEPTH):
            health.hear(source, 7.5 + jump_s)
        assert health.present() is None


def test_a_robot_at_rest_says_what_it_waits_for(monkeypatch, caplog):
    monkeypatch.setattr(commander, "_LONG_S", 0.3)
    health = Health(0.1)
    health.expect("the depth on /depth")
    with closing(commander.Commander(Mock(spec=Node), RosConfig(), health, dry=True)):
        wait_until(lambda: "The robot waits: nothing was heard of the depth on /depth for 0.1 s." in caplog.text)
        stamps = itertools.count(1)
        wait_until(
            lambda: (health.hear("the depth on /depth", 0.1 * next(stamps)), "The robot goes on" in caplog.text)[1]
        )
