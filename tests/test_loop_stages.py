"""What a policy hears of."""

from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.localisation.localiser import Localiser, PoseEstimate, RegistrationQuality, TrackingState
from anm_mj.loop_stages import learn
from anm_mj.protocols import Mapper, Policy
from anm_mj.types import MapUpdate, Pose2
from anm_mj.utils.stopwatch import Stopwatch
from tests.box_room import observe


@pytest.mark.parametrize("usable", [True, False])
def test_a_policy_hears_of_what_enters_the_map(usable):
    seen = observe(0, Pose2(0.0, 0.0, 0.0))
    quality = RegistrationQuality(1.0, 1.0, 0.0, 3, 3)
    estimate = PoseEstimate(seen, np.eye(6), quality, TrackingState.TRACKING, usable)
    localiser = Mock(spec=Localiser, integrate=Mock(return_value=MapUpdate(0.0, 1, 1)))
    policy = Mock(spec=Policy)

    learn(seen, estimate, localiser, Mock(spec=Mapper), policy, Stopwatch())

    assert policy.observe.called == localiser.integrate.called == usable
