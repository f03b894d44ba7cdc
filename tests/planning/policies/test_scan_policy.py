"""Where policies that scan remember that the base was."""

import numpy as np
import pytest

from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.scan_policy import ScanPolicy
from anm_mj.types import FORWARD_STEP_M, Footprint
from tests.mapping.ray_room import Room


@pytest.mark.parametrize(
    ("moved_m", "between"),
    [(0.0, []), (FORWARD_STEP_M, [0.5 * FORWARD_STEP_M]), (1.9 * FORWARD_STEP_M, [0.95 * FORWARD_STEP_M]), (1.0, [])],
    ids=["turn", "step", "bad step", "relocalised"],
)
def test_the_base_was_between_the_poses_of_a_step_and_of_no_jump(moved_m, between):
    policy = ScanPolicy(PolicyContext(Footprint(0.18, 0.05, 1.35), None), 3.0)
    for x_m in (1.0, 1.0 + moved_m):
        policy.observe(Room().observe(x_m, 1.5, 0.0, size=16))
    beyond = [*between, moved_m] if moved_m else []
    assert policy._driven_m == pytest.approx(np.array([[1.0 + more_m, 1.5] for more_m in (0.0, *beyond)]))
