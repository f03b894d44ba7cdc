import numpy as np

from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.gvg.config import GvgConfig
from anm_mj.planning.policies.gvg.policy import Gvg
from anm_mj.types import Footprint, Observation, Pose2, StopReason
from tests.box_room import CAMERA, camera_pose, room_depth
from tests.planning.worlds import room


def look(pose: Pose2) -> Observation:
    T_world_camera = camera_pose(pose)
    return Observation(
        0, 0.0, np.zeros((256, 256, 3), np.uint8), room_depth(T_world_camera), CAMERA, T_world_camera, pose
    )


def test_a_plan_that_has_been_followed_is_not_gone_on_with_although_its_target_was_noted_elsewhere(monkeypatch):
    world = room(8, 4, unknown=[(5.2, 0.2, 8.2, 4.2)])
    policy = Gvg(PolicyContext(Footprint(0.18, 0.05, 1.35), GvgConfig(bootstrap_turns=0)))
    first = policy.plan(world, look(Pose2(1.5, 2.0, 2.0)))
    assert policy._ledger.target_xy_m is not None
    policy._ledger.target_xy_m = policy._ledger.target_xy_m + 0.4
    nothing = np.zeros(0, np.int64), np.zeros(0)
    monkeypatch.setattr(policy._caster, "expectation", lambda *of: (*nothing, 100.0))
    end = first.path_xy_m[-1] if len(first.path_xy_m) else np.array([1.5, 2.0])

    again = policy.plan(world, look(Pose2(float(end[0]), float(end[1]), first.headings_rad[-1])))

    assert not again.reason.startswith("goes on")


def test_in_a_lull_crumbs_are_left_and_a_tour_that_promises_more_is_gone_on_with(monkeypatch):
    world = room(8, 4, unknown=[(5.2, 0.2, 8.2, 4.2)])
    ends = {}
    for lull, crumbs_m2 in ((True, 1000.0), (True, 0.01), (False, 1000.0)):
        policy = Gvg(
            PolicyContext(Footprint(0.18, 0.05, 1.35), GvgConfig(bootstrap_turns=0, stagnation_gain_m2=crumbs_m2))
        )
        monkeypatch.setattr(policy._progress, "is_lull", lambda lull=lull: lull)
        ends[lull, crumbs_m2] = policy.plan(world, look(Pose2(1.5, 2.0, 2.0)))

    assert ends[True, 1000.0].stop is StopReason.COMPLETE
    assert ends[True, 1000.0].reason.startswith("next to nothing was seen in the last 10% of the steps")
    assert ends[True, 0.01].stop is None
    assert ends[False, 1000.0].stop is None
