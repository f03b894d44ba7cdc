"""Settings of the gvg policy."""

from dataclasses import dataclass

from anm_mj.planning.policies.context import PolicyConfig
from anm_mj.types import ARRIVED_M
from anm_mj.utils.settings import setting

AS_MANY_AS_NEEDED = -1
"""Turns of the first rotation: the camera's field of view decides."""


@dataclass(frozen=True)
class GvgConfig(PolicyConfig):
    """What the policy expects of views, how it searches for tours, and when it keeps or ends them."""

    bootstrap_turns: int = setting(AS_MANY_AS_NEEDED, at_least=AS_MANY_AS_NEEDED)
    """Turns of the first rotation, of 10 degrees each; -1 = as many as show all around to the robot's camera, 27 for a
    view of 90 degrees."""
    gain_range_m: float = setting(4.5, at_least=0.5, at_most=100.0)
    """A view is expected to show surface up to this distance [m]."""
    num_elevations: int = setting(12, at_most=360)
    """Elevations of the rays that compute gain, within the camera's vertical field of view."""
    max_unknown_depth_m: float = 1.5
    """Surface is expected as far behind the first unknown cell as the unknown extends, up to this depth [m]."""
    suppressed_share: float = setting(0.6, at_most=1.0)
    """A cell that a view left unknown has gain only from nearer than this share of that view's distance."""
    candidate_spacing_m: float = 0.5
    """Candidate vertices lie at least this far apart [m]."""
    same_place_m: float = setting(0.2, at_least=ARRIVED_M)
    """Vertices nearer than this are no candidates: the robot looks from where it stands [m]."""
    shortlist_spacing_m: float = 1.0
    """No two places that tours are searched among lie in the same square of this side [m]."""
    max_candidates: int = setting(16, at_most=10_000)
    """Most places that tours are searched among."""
    tour_depth: int = setting(4, at_most=32)
    """Most views in a tour."""
    tour_width: int = setting(4, at_most=100)
    """Tours kept at each depth of the beam search."""
    max_tours: int = setting(8, at_most=10_000)
    """Of the tours found, the policy tries at most this many for one whose first view a path leads to."""
    discount_steps: float = 100.0
    """Gain after this many steps counts 1/e [steps]."""
    max_discount_ratio: float = setting(4.0, at_least=1.0)
    """Where most of the gain lies farther away, the discount length grows up to this many times ``discount_steps``."""
    far_discount_ratio: float = setting(1.2, at_least=1.0)
    """From this many times ``discount_steps`` on, tours for the longer discount are searched too."""
    far_rate_ratio: float = 1.5
    """They are taken if they expect this many times as much new surface per step."""
    min_gain_m2: float = 0.1
    """Views with less expected new surface than this count nothing [m2]."""
    min_rate_m2: float = 0.002
    """Tours with less expected new surface per step than this are not worth their steps [m2 per step]."""
    failed_share: float = setting(0.25, at_most=1.0)
    """A target that brought less than this share of its expected gain has failed: its cells are suppressed."""
    standing_share: float = setting(0.5, at_most=1.0)
    """A target that the robot leaves on the way is not judged while its view still expects this share."""
    poor_target_m2: float = 0.12
    """A target that brought less new surface than this is poor [m2]."""
    patience_targets: int = 4
    """After so many poor targets in a row nothing more is expected of small gains."""
    large_gain_m2: float = 1.5
    """For an expected gain larger than this the patience is twice as long [m2]."""
    stagnation_share: float = 0.1
    """The run stagnates when the last so large a share of all steps showed next to nothing new."""
    min_stagnation_steps: int = 50
    """The least length of that window: a path across a room shows nothing new either [steps]."""
    useful_share: float = setting(0.0025, at_most=1.0)
    """Less new surface in the window than this share of all that was seen is next to nothing."""
    stagnation_gain_m2: float = 2.5
    """While the run stagnates, a tour needs this much expected new surface [m2]."""
    improvement_radius_m: float = 6.0
    """Expected errors of the surface are recomputed within this distance of the robot and remembered beyond [m]."""
    improvement_steps: int = 24
    """While the robot keeps a target, expected errors are recomputed after this many steps."""
    door_share: float = setting(0.5, at_least=0.0)
    """A wide robot looks at a narrow passage where more is expected behind it than this share of the best place."""
    hysteresis: float = 1.25
    """A new target must score this many times the present one to replace it."""
    replan_steps: int = 8
    """The policy decides again after this many steps."""
    replan_gain_m2: float = 1.0
    """While less new surface than this was seen since the last full decision, the plan is reused [m2]."""
    replan_gain_share: float = 0.3
    """The same as a share of the gain expected of the target's view; the larger of the two counts."""
    reuse_share: float = setting(0.6, at_most=1.0)
    """The plan is reused while the target's view still expects this share of its gain."""
    max_plan_reuse: int = 8
    """After so many reuses of a plan a full decision is due."""
