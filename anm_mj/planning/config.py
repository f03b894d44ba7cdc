"""The planner's settings."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from anm_mj.errors import PlanError

_MAY_BE_ZERO = ("margin_m", "bootstrap_turns", "gvg_bootstrap_turns", "start_radius_m")

TARGETS = ("hierarchical", "best-anchored", "random")
"""Ways of the anm-s policy to choose: local horizon first, then near to far; the most uncertain; any unvisited."""

VISITED_BY = ("sight", "place")
"""What spares a vertex a visit: to have been near it or to have seen what surrounds it; to have been near it alone."""


@dataclass(frozen=True)
class PlanningConfig:
    """Settings of all planning stages; lengths in metres, angles in degrees, costs in steps."""

    margin_m: float = 0.04
    """Clearance kept beyond the robot's radius [m]."""
    sdf_height_spacing_m: float = 0.15
    """Distance between the heights at which a column asks the SDF [m]."""
    free_share: float = 0.5
    """Share of a column's voxels that must have been seen free for the column to be free."""
    start_radius_m: float = 0.75
    """Around the start the floor lies below the camera's view; taken as free up to here unless seen otherwise [m]."""
    hole_area_m2: float = 0.15
    """Unknown patches enclosed by known space and smaller than this are taken as free [m2]."""
    update_reach_m: float = 5.2
    """Views change the map up to this depth; what they show beyond is taken in when the robot comes nearer [m]."""
    horizon_m: float = 5.0
    """Side of the local horizon that moves with the robot, inside which surfaces are taken finely [m]."""
    fine_spacing_m: float = 0.1
    """Distance between surface points that the graph is built from inside the horizon [m]."""
    coarse_spacing_m: float = 0.2
    """The same outside of the horizon [m]."""
    far_m: float = 10.0
    """From this far on the gvg policy needs no more than a rough graph [m]."""
    min_site_distance_m: float = 0.3
    """Ridges between surface points nearer to each other than this lead into walls, not along them [m]."""
    region_percentile: float = 80.0
    """Surface points above this percentile of uncertainty may form regions [%]; as in the authors' released code."""
    region_radius_m: float = 6.0
    """Uncertainty is asked anew within this distance of the robot and remembered beyond [m]: what the vertices in the
    local horizon can see."""
    region_max_height_m: float = 1.5
    """Higher surface forms no regions [m]."""
    region_link_m: float = 0.45
    """Parts of one region, a quarter of a metre in size, lie nearer to each other than this [m]."""
    region_min_members: int = 12
    """Smaller clusters are noise."""
    anchor_range_m: float = 3.5
    """A region is anchored to a vertex it can be seen from within this range [m]."""
    anchor_max_incidence_deg: float = 75.0
    """Largest angle between the view and the region's normal [deg]."""
    visited_radius_m: float = 0.975
    """Vertices nearer than this to where the robot has been are visited [m]: 15 forward steps."""
    visited_by: str = "sight"
    """Whether vertices come last whose surroundings were seen well from elsewhere: one of ``VISITED_BY``."""
    gain_range_m: float = 4.5
    """A view is expected to show surface up to this distance, and what was seen from within it is known well [m]."""
    num_azimuths: int = 36
    """Directions in which gain is cast about a place."""
    num_elevations: int = 12
    """Elevations within the camera's vertical field of view."""
    candidate_spacing_m: float = 0.5
    """Vertices weighed by the gvg policy lie at least this far apart [m]."""
    shortlist_spacing_m: float = 1.0
    """No two places that tours are searched among lie in the same square of this side [m]."""
    max_candidates: int = 16
    """Most places that tours are searched among."""
    tour_depth: int = 4
    """Most stops in a tour that is searched for."""
    tour_width: int = 4
    """Tours kept at each depth of the search."""
    discount_steps: float = 100.0
    """Gain that is had only after this many steps counts 1/e; more where most of it lies farther away [steps]."""
    min_gain_m2: float = 0.1
    """Expected new surface below which nothing is worth a step [m2]."""
    min_rate_m2: float = 0.002
    """A tour that promises less new surface per step is not worth its way [m2 per step]."""
    poor_target_m2: float = 0.12
    """A target that brought less new surface than this was not worth its way [m2]."""
    patience_targets: int = 4
    """After so many poor targets in a row nothing more is expected of small ones."""
    large_gain_m2: float = 1.5
    """A promise larger than this is looked into for as long again [m2]."""
    lull_share: float = 0.1
    """In the last so large a share of all steps nothing useful was seen: a lull."""
    lull_gain_m2: float = 2.5
    """In a lull a whole tour must promise this much new surface to be worth its way [m2]."""
    hysteresis: float = 1.25
    """A new target must score this many times the present one to replace it."""
    replan_steps: int = 8
    """The gvg policy decides anew after this many steps."""
    news_m2: float = 1.0
    """While less new surface than this was seen since the last full decision, a target that stands is kept [m2]."""
    keep_decisions: int = 8
    """After so many short decisions a full one is due."""
    gvg_bootstrap_turns: int = 27
    """Turns of the first look around of the gvg policy: three quarters of a turn show all to a view of 90 degrees."""
    target: str = "hierarchical"
    """How the anm-s policy chooses among vertices: one of ``TARGETS`` (the paper's ablation, section V-D)."""
    visibility_guidance: bool = True
    """Whether the anm-s policy prefers vertices with regions anchored to them and turns to these on arrival."""
    bootstrap_turns: int = 36
    """Turns of the first look around (paper, section V-D)."""

    def __post_init__(self) -> None:
        """Refuse values that no plan can be made with.

        Raises:
            PlanError: a value is not positive, or a share lies outside (0, 1].
        """
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, str | bool):
                continue
            if not math.isfinite(value) or value < 0 or (value == 0 and f.name not in _MAY_BE_ZERO):
                raise PlanError(f"planning.{f.name} is {value}; it must be a number above zero.")
        if self.target not in TARGETS:
            raise PlanError(f"planning.target is '{self.target}'; it must be one of {', '.join(TARGETS)}.")
        if self.free_share > 1.0:
            raise PlanError(f"planning.free_share is {self.free_share}; it must be in (0, 1].")
        if self.region_percentile >= 100.0:
            raise PlanError(f"planning.region_percentile is {self.region_percentile}; it must be below 100.")
        if self.visited_by not in VISITED_BY:
            raise PlanError(f"planning.visited_by is '{self.visited_by}'; it must be one of {', '.join(VISITED_BY)}.")
        if self.gain_range_m < 0.5:
            raise PlanError(f"planning.gain_range_m is {self.gain_range_m}; nothing is seen nearer than 0.5.")
