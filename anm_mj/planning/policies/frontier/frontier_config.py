"""Settings of the frontier policy."""

from dataclasses import dataclass

from anm_mj.planning.policies.context import PolicyConfig
from anm_mj.utils.settings import setting


@dataclass(frozen=True)
class FrontierConfig(PolicyConfig):
    """How far the policy scans, and when it leaves a frontier for later or gives it up."""

    range_m: float = setting(3.0, at_most=100.0)
    """Depth beyond this is ignored [m]; 3 m as published, 10 m is the camera's range in the paper's protocol."""
    min_distance_m: float = setting(1.0, at_least=0.0)
    """Frontiers nearer than this come after all others [m]."""
    replan_steps: int = 10
    """The policy decides again after this many steps."""
    max_gap_m: float = 0.75
    """A frontier is out of reach when every place the robot can get to is farther from it than this [m]."""
    given_up_m: float = 0.3
    """Frontiers this near to one that was given up are given up with it [m]."""
