"""The values that cross a stage border: frozen, numpy only, each with shape, unit and frame.

Conventions, once for the whole project: the world is right-handed with z up and the floor at z = 0; ``T_a_b`` maps
coordinates of frame ``b`` to frame ``a``; camera axes are x right, y down, z forward; depth is planar z in metres, in
observations +inf where the sensor looked farther than its range and NaN where it measured nothing; pixel centres lie at
+0.5; two-dimensional grids are indexed ``[row, col]`` with row along world y and col along world x, three-dimensional
ones ``[layer, row, col]`` with layer along world z.
"""

from anm_mj.types.map import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    FormerRun,
    MapUpdate,
    OccupancyGrid,
    SdfQuery,
    SurfaceChange,
    SurfaceErrors,
    SurfacePoints,
    TrainingEffort,
)
from anm_mj.types.motion import (
    ARRIVED_M,
    FORWARD_STEP_M,
    NEAR_TARGET_M,
    TURN_STEP_RAD,
    Action,
    ActionResult,
    MotionResult,
    StopReason,
    Twist,
    WheelSpeeds,
)
from anm_mj.types.observation import Footprint, Intrinsics, Observation, PixelState, Pose2, TrueView
from anm_mj.types.plan import Candidate, Plan, Region, TopDownMap, UnexploredPatch, VoronoiGraph

__all__ = [
    "ARRIVED_M",
    "FORWARD_STEP_M",
    "FREE",
    "NEAR_TARGET_M",
    "OCCUPIED",
    "TURN_STEP_RAD",
    "UNKNOWN",
    "Action",
    "ActionResult",
    "Candidate",
    "Footprint",
    "FormerRun",
    "Intrinsics",
    "MapUpdate",
    "MotionResult",
    "Observation",
    "OccupancyGrid",
    "PixelState",
    "Plan",
    "Pose2",
    "Region",
    "SdfQuery",
    "StopReason",
    "SurfaceChange",
    "SurfaceErrors",
    "SurfacePoints",
    "TopDownMap",
    "TrainingEffort",
    "TrueView",
    "Twist",
    "UnexploredPatch",
    "VoronoiGraph",
    "WheelSpeeds",
]
