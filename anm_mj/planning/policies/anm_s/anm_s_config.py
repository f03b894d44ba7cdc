"""Settings of the anm-s policy, those of the paper's ablations (section V-D) among them."""

from dataclasses import dataclass

from anm_mj.planning.policies.context import PolicyConfig
from anm_mj.utils.settings import setting

TARGETS = ("hierarchical", "best-anchored", "random")
"""How the policy chooses: local horizon first, then near to far; the most uncertain region; any unvisited vertex."""
VISITED_BY = ("sight", "place")
"""What makes a vertex visited: the robot was near it or saw what surrounds it; the robot was near it."""


@dataclass(frozen=True)
class AnmSConfig(PolicyConfig):
    """How the policy chooses among the graph's vertices, and when it counts one as visited or gives one up."""

    target: str = setting("hierarchical", choices=TARGETS)
    """How the policy chooses among vertices: one of ``TARGETS``."""
    visibility_guidance: bool = True
    """Whether the policy prefers vertices with regions anchored to them and turns to these on arrival."""
    bootstrap_turns: int = setting(36, at_least=0)
    """Turns of the first rotation, of 10 degrees each."""
    visited_by: str = setting("sight", choices=VISITED_BY)
    """Whether vertices whose surroundings were seen well from elsewhere come last: one of ``VISITED_BY``."""
    visited_radius_m: float = 0.975
    """Vertices nearer than this to where the robot has been are visited [m]: 15 forward steps."""
    seen_well_m: float = 4.5
    """Surface that was seen from within this distance was seen well [m]."""
    seen_well_share: float = setting(0.9, at_most=1.0)
    """Share of a vertex's border that must have been seen well for the vertex to count as seen."""
    replan_steps: int = 10
    """The policy asks after this many steps whether the target still holds."""
    fail_radius_m: float = 0.3
    """Vertices this near to a target whose path led into an obstacle come last [m]."""
    max_fails: int = 2
    """After so many collisions on its path a target is given up."""
    max_changes: int = 3
    """A target that the robot turned from so often is given up: the graph has it only from afar, where it is rough."""
    same_target_m: float = 1.0
    """The graph changes; the vertex nearest to the target within this distance takes its place [m]."""
    well_in_view_deg: float = setting(30.0, below=180.0)
    """A region less than this off the camera's axis is well in view [deg]; in views narrower than 90 degrees less in
    proportion."""
