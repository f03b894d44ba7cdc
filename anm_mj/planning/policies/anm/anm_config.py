"""Settings of the anm policy."""

from dataclasses import dataclass

from anm_mj.planning.policies.context import PolicyConfig
from anm_mj.utils.settings import setting


@dataclass(frozen=True)
class AnmConfig(PolicyConfig):
    """Which surface counts as uncertain, and where the targets before it lie."""

    range_m: float = setting(10.0, at_most=100.0)
    """Depth beyond this is left out of the policy's own grid [m]."""
    near_m: float = 5.0
    """Half width of the local horizon [m]."""
    percentile: float = setting(90.0, below=100.0)
    """Surface above this percentile of uncertainty counts as uncertain [%] (paper; the released code keeps four
    fifths)."""
    link_m: float = 0.3
    """Points nearer to each other than this belong to one cluster [m]."""
    min_share: float = setting(0.005, at_most=1.0)
    """Clusters with a smaller share of the uncertain points are dropped."""
    stand_off_m: float = 0.5
    """Targets lie this far before the surface [m]."""
    min_distance_m: float = setting(1.0, at_least=0.0)
    """Targets nearer than this are taken only when there is no other [m]."""
    arrived_m: float = 0.8
    """The robot has reached a target when it is this near to it [m]."""
    max_steps: int = 100
    """The policy decides again after this many steps."""
    full_rotation_turns: int = 36
    """Turns of the rotation when no target can be reached, of 10 degrees each."""
