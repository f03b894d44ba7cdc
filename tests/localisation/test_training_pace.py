"""How much is trained on each frame."""

import pytest

from anm_mj.localisation.localisation_config import TrackingConfig
from anm_mj.localisation.training_pace import TrainingPace


@pytest.mark.parametrize("every", [1, 2, 4])
def test_the_first_frame_is_a_keyframe_as_it_is_for_the_field(every):
    pace = TrainingPace(TrackingConfig(fresh_keyframe_every=every, young_frames=100))
    are_keyframes = [pace.next(known=1.0, has_keyframes=k > 0).is_keyframe for k in range(2 * every + 1)]
    assert are_keyframes == [k % every == 0 for k in range(2 * every + 1)]


def test_after_frames_that_the_map_left_out_the_next_is_a_keyframe():
    pace = TrainingPace(TrackingConfig(fresh_keyframe_every=4, young_frames=100))
    kept = [pace.next(known=1.0, has_keyframes=k > 1).is_keyframe for k in range(4)]
    assert kept == [True, True, False, False]
