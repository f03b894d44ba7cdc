"""Settings of the planning stages that the policies share: top-down map, Voronoi graph, paths, regions."""

from dataclasses import dataclass

from anm_mj.errors import PlanError
from anm_mj.utils.settings import Settings, setting


@dataclass(frozen=True)
class PlanningConfig(Settings, group="planning", error=PlanError):
    """Settings of the shared planning stages; each policy has a configuration of its own beside it."""

    margin_m: float = setting(0.04, at_least=0.0, at_most=10.0)
    """Clearance kept beyond the robot's radius [m]."""
    sdf_height_spacing_m: float = setting(0.15, at_least=0.01)
    """Distance between the heights at which a column asks the SDF [m]."""
    free_share: float = setting(0.5, at_most=1.0)
    """Share of a column's voxels that must have been seen free for the column to be free."""
    start_radius_m: float = setting(0.75, at_least=0.0, at_most=100.0)
    """The camera cannot see the floor around the start; up to this distance it counts as free unless seen otherwise,
    and farther where the camera's height, tilt and field of view show too little of the body's heights [m]."""
    hole_area_m2: float = 0.15
    """Unknown patches that known space encloses count as free below this area [m2]."""
    update_reach_m: float = 5.2
    """Views change the map up to this depth; the map takes in what lies beyond when the robot comes nearer [m]. Views
    free space up to 5 m and mark surface up to 8 m: surface with unknown space before it misleads policies."""
    patience_steps: int = setting(30, at_least=1, at_most=10000)
    """The robot waits so long for what moves in its way, then takes it for an obstacle and looks for another way."""
    horizon_m: float = 5.0
    """Side of the local horizon, a square that moves with the robot, inside which the graph is fine [m]."""
    fine_spacing_m: float = 0.1
    """Distance between the surface points that the graph is built from, inside the horizon [m]."""
    coarse_spacing_m: float = 0.2
    """The same outside of the horizon [m]."""
    far_m: float = 10.0
    """Policies that ask for a graph thinned out far away get it from this distance on [m]."""
    min_site_distance_m: float = 0.3
    """Ridges between surface points nearer to each other than this lead into walls, not along them [m]; for a narrow
    robot, nearer than twice the clearance that its paths keep."""
    region_percentile: float = setting(80.0, below=100.0)
    """Surface points above this percentile of uncertainty may form regions [%]; as in the authors' released code."""
    region_known_by: str = setting("range", choices=("error", "range"))
    """What makes surface known, so that it forms no region however uncertain it is beside the rest: ``range``, it was
    seen from within ``anchor_range_m``; ``error``, the map expects it to be off by less than ``region_error_m``."""
    region_error_m: float = 0.005
    """With ``error``, surface whose expected error has a larger reducible part than this is known badly [m]."""
    region_radius_m: float = 6.0
    """Uncertainty is recomputed within this distance of the robot and remembered beyond [m]: what the vertices in
    the local horizon can see."""
    region_max_height_m: float = 1.5
    """Higher surface forms no regions [m]."""
    region_link_m: float = 0.45
    """Parts of one region, a quarter of a metre in size, lie nearer to each other than this [m]."""
    region_min_members: int = 12
    """Smaller clusters are noise [surface points]."""
    anchor_range_m: float = 3.5
    """A region is anchored to a vertex that sees it from within this range, and three quarters of the camera's [m]."""
    anchor_max_incidence_deg: float = 75.0
    """Largest angle between the view and the region's normal [deg]."""
    uncertainty_aware: bool = True
    """Whether plans weigh certainty where poses are estimated; the next four say how."""
    unbound_step_cost: float = setting(0.0, at_least=0.0)
    """A step whose view binds the position in one direction at most counts as so many steps more (policy ``gvg``)."""
    bound_share: float = setting(0.05, at_most=0.5)
    """A view binds the position fully where its surface holds the direction that it holds least with this share of its
    rays."""
    return_deviation_m: float = 0.025
    """Where the standard deviation of the position exceeds this, the robot goes back to where it was half of it [m]."""
    return_deviation_rad: float = 0.015
    """Where the standard deviation of the heading exceeds this, it does so, too [rad]."""
