from anm_mj.evaluation.metrics import EpisodeStatistics
from anm_mj.types import Action

L, R, F = Action.TURN_LEFT, Action.TURN_RIGHT, Action.MOVE_FORWARD


def travelled(steps):
    travel = EpisodeStatistics()
    for action, moved_m in steps:
        travel = travel.after(action, action is F and moved_m == 0.0, moved_m, {"map": 50.0, "plan": 0.0})
    return travel


def test_steps_are_forwards_turns_or_blocked():
    travel = travelled([(F, 0.065), (L, 0.0), (R, 0.0), (F, 0.0), (F, 0.065)])

    assert (travel.forwards, travel.turns, travel.blocked, travel.collisions) == (2, 2, 1, 1)
    assert travel.steps == 5


def test_a_full_rotation_goes_to_one_side():
    assert travelled([(L, 0.0)] * 35).full_rotations == 0
    assert travelled([(L, 0.0)] * 36).full_rotations == 1
    assert travelled([(R, 0.0)] * 73).full_rotations == 2
    assert travelled([(L, 0.0)] * 35 + [(R, 0.0)] * 35).full_rotations == 0
    assert travelled([(L, 0.0)] * 20 + [(F, 0.065)] + [(L, 0.0)] * 20).full_rotations == 0
    # A robot that waits for somebody, or is held, has not moved.
    for rest in ((Action.WAIT, 0.001), (F, 0.0)):
        assert travelled([(L, 0.0)] * 20 + [rest] * 3 + [(L, 0.0)] * 16 + [rest]).full_rotations == 1


def test_stage_rates():
    assert travelled([(F, 0.065)] * 4).stage_hz == {"map": 20.0}
    assert EpisodeStatistics().stage_hz == {}


def test_a_robot_that_creeps_while_it_waits_has_waited():
    creeping = EpisodeStatistics().after(Action.WAIT, False, 1e-6, {})
    assert (creeping.waits, creeping.forwards, creeping.steps) == (1, 0, 1)
