"""The values that cross a stage border: frozen, numpy only, each with shape, unit and frame.

Conventions, once for the whole project: the world is right-handed with z up and the floor at z = 0; ``T_a_b`` maps
coordinates of frame ``b`` to frame ``a``; camera axes are x right, y down, z forward; depth is planar z in metres, in
observations +inf where the sensor looked farther than its range and NaN where it measured nothing; pixel centres lie at
+0.5; two-dimensional grids are indexed ``[row, col]`` with row along world y and col along world x, three-dimensional
ones ``[layer, row, col]`` with layer along world z.
"""

from anm_mj.types.map import FREE as FREE
from anm_mj.types.map import OCCUPIED as OCCUPIED
from anm_mj.types.map import UNKNOWN as UNKNOWN
from anm_mj.types.map import ExploredState as ExploredState
from anm_mj.types.map import MapUpdate as MapUpdate
from anm_mj.types.map import OccupancyGrid as OccupancyGrid
from anm_mj.types.map import SdfQuery as SdfQuery
from anm_mj.types.map import SurfaceChange as SurfaceChange
from anm_mj.types.map import SurfaceErrors as SurfaceErrors
from anm_mj.types.map import SurfacePoints as SurfacePoints
from anm_mj.types.map import TrainingEffort as TrainingEffort
from anm_mj.types.map import thinning_stride as thinning_stride
from anm_mj.types.motion import ARRIVED_M as ARRIVED_M
from anm_mj.types.motion import FORWARD_STEP_M as FORWARD_STEP_M
from anm_mj.types.motion import NEAR_TARGET_M as NEAR_TARGET_M
from anm_mj.types.motion import TURN_STEP_RAD as TURN_STEP_RAD
from anm_mj.types.motion import Action as Action
from anm_mj.types.motion import ActionResult as ActionResult
from anm_mj.types.motion import MotionResult as MotionResult
from anm_mj.types.motion import StopReason as StopReason
from anm_mj.types.motion import Twist as Twist
from anm_mj.types.motion import WheelSpeeds as WheelSpeeds
from anm_mj.types.observation import DEFAULT_FOOTPRINT as DEFAULT_FOOTPRINT
from anm_mj.types.observation import Footprint as Footprint
from anm_mj.types.observation import Intrinsics as Intrinsics
from anm_mj.types.observation import Observation as Observation
from anm_mj.types.observation import PixelState as PixelState
from anm_mj.types.observation import Pose2 as Pose2
from anm_mj.types.observation import TruePeople as TruePeople
from anm_mj.types.observation import TrueView as TrueView
from anm_mj.types.plan import Candidate as Candidate
from anm_mj.types.plan import Plan as Plan
from anm_mj.types.plan import Region as Region
from anm_mj.types.plan import TargetOutcome as TargetOutcome
from anm_mj.types.plan import TopDownMap as TopDownMap
from anm_mj.types.plan import UnexploredPatch as UnexploredPatch
from anm_mj.types.plan import VoronoiGraph as VoronoiGraph
