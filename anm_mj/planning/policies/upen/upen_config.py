"""Settings of the upen policy."""

from dataclasses import dataclass

from anm_mj.planning.policies.context import PolicyConfig
from anm_mj.types import FORWARD_STEP_M
from anm_mj.utils.settings import setting


@dataclass(frozen=True)
class UpenConfig(PolicyConfig):
    """The random tree that the policy grows, and how long it follows a path."""

    range_m: float = setting(10.0, at_most=100.0)
    """Depth beyond this is left out of the policy's own grid [m]."""
    num_samples: int = setting(2500, at_most=100_000)
    """Samples that the tree is grown towards."""
    hop_m: float = 0.25
    """Length of an edge of the tree [m]."""
    num_hops: int = setting(10, at_most=1000)
    """Edges of the paths that are compared."""
    replan_steps: int = round(10 * 0.25 / FORWARD_STEP_M)
    """The policy decides again after this many steps: ten of the original's steps of 25 cm, which is about the length
    of a path. After ten steps of 6.5 cm the robot would turn to one path after the other and follow none."""
    max_occupied_probability: float = setting(0.5, at_most=1.0)
    """Paths avoid unknown cells whose mean predicted probability of an obstacle is higher."""
