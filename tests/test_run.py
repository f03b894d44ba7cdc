"""What a run says at its end, and where it begins."""

from unittest.mock import Mock

import pytest

from anm_mj.config import make_config
from anm_mj.events import Ended
from anm_mj.recording.recorder import RunRecorder
from anm_mj.run import _where_it_was
from anm_mj.run_parts import _somewhere, make_parts
from anm_mj.scene.folder import load_scene
from anm_mj.sim.sim_robot import SimRobot
from anm_mj.types import DEFAULT_FOOTPRINT, Pose2, StopReason
from tests.box_room import observe

KNOWN, BELIEVED = Pose2(1.0, 1.0, 0.0), Pose2(9.0, 9.0, 0.0)


@pytest.mark.parametrize("stop", [StopReason.LOST, StopReason.BUDGET, StopReason.INTERRUPTED])
def test_a_run_that_ends_lost_is_surveyed_from_where_it_knew_that_it_was(stop):
    recorder = Mock(spec=RunRecorder, poses=[KNOWN], prior=None)
    ended = Mock(spec=Ended, observation=observe(3, BELIEVED), stop_reason=stop)
    assert _where_it_was(recorder, ended, is_lost=True).pose == KNOWN
    assert _where_it_was(recorder, ended, is_lost=False).pose == BELIEVED


def test_a_robot_that_starts_somewhere_restarts_there_with_all_who_are_about():
    robot = Mock(spec=SimRobot, footprint=DEFAULT_FOOTPRINT)
    config = _somewhere(make_config("quick", [], scene="home"), load_scene("home"), robot)
    (start,), _ = robot.restart.call_args
    assert config.start is not None
    assert config.start[:2] == (start.x_m, start.y_m)


@pytest.mark.parametrize(("stamp_error_s", "differs"), [(0.0, False), (-0.1, True)])
def test_what_was_seen_counts_from_where_the_camera_was_where_its_stamps_are_wrong(stamp_error_s, differs):
    settings = ["image_px=32", f"sensor.stamp_error_s={stamp_error_s}"]
    with make_parts(make_config("quick", settings, scene="room")) as parts:
        assert (parts.true_view is not None) == differs
