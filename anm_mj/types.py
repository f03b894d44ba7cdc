"""The values that cross a stage border: frozen, numpy only, each with shape, unit and frame.

Conventions, once for the whole project: the world is right-handed with z up and the floor at z = 0; ``T_a_b`` maps
coordinates of frame ``b`` to frame ``a``; camera axes are x right, y down, z forward; depth is planar z in metres, in
observations +inf where the sensor looked farther than its range and NaN where it measured nothing; pixel centres lie at
+0.5; two-dimensional grids are indexed ``[row, col]`` with row along world y and col along world x, three-dimensional
ones ``[layer, row, col]`` with layer along world z.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int, Int8, UInt8

FREE = 0
"""State of a cell that depth rays passed through."""
OCCUPIED = 1
"""State of a cell that holds a surface."""
UNKNOWN = -1
"""State of a cell that was never observed."""

_EDGE = 1e-6
"""A height this near to a face between two layers lies on it [layers]."""

FORWARD_STEP_M = 0.065
"""Length of one forward step [m] (paper, section V-A)."""
TURN_STEP_RAD = math.radians(10.0)
"""Angle of one turn [rad] (paper, section V-A)."""
ARRIVED_M = 1.5 * FORWARD_STEP_M
"""The robot has reached a place that is nearer than this [m]."""
NEAR_TARGET_M = 2 * ARRIVED_M
"""From nearer than this the robot sees what it came to a target for, even where its path ended early [m]."""


SdfQuery = Callable[[Float[np.ndarray, "n 3"]], Float32[np.ndarray, " n"]]
"""World points [m] to signed distance."""


class Action(IntEnum):
    """One discrete action; every one but STOP costs one step of the budget."""

    STOP = 0
    MOVE_FORWARD = 1
    TURN_LEFT = 2
    TURN_RIGHT = 3


class StopReason(StrEnum):
    """Why a run ended."""

    COMPLETE = "COMPLETE"
    """Nothing reachable is worth another step."""
    BUDGET = "BUDGET"
    """The budget of steps was spent."""
    NO_REACHABLE_TARGET = "NO_REACHABLE_TARGET"
    """Something is unexplored, but no path leads to it."""
    RETURNED = "RETURNED"
    """The robot is back at its start, because the budget allowed no more than the way back."""
    STUCK = "STUCK"
    """The robot collided again and again without a free step in between."""
    SENSOR_FAULT = "SENSOR_FAULT"
    """The camera stopped measuring: no depth, or the same image again and again."""
    POLICY_ERROR = "POLICY_ERROR"
    """The policy failed, or returned a plan that cannot be executed."""
    MAP_ERROR = "MAP_ERROR"
    """The map could not be trained any further: its loss was not finite again and again."""
    TOPPLED = "TOPPLED"
    """The robot fell over."""
    NO_TRACTION = "NO_TRACTION"
    """The robot did not go where its wheels drove it, again and again, although nothing was in the way."""
    WHEEL_STUCK = "WHEEL_STUCK"
    """A wheel did not turn although it was driven, again and again."""
    DIVERGED = "DIVERGED"
    """The simulation of the robot became unstable."""
    LOST = "LOST"
    """The robot did not know where it was, and no place in its map fitted what it saw."""
    INTERRUPTED = "INTERRUPTED"
    """A person ended the run."""


class PixelState(IntEnum):
    """What a pixel of a depth image is; the first two tell where free space is."""

    MEASURED = 0
    OUT_OF_RANGE = 1
    """The sensor says that it looked farther than its range."""
    LOST = 2
    """Nothing was measured."""
    OUTLIER = 3
    """Something was measured that the pixels beside it contradict."""


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion; pixel (u, v) has its centre at (u + 0.5, v + 0.5)."""

    width: int
    """Columns [px]."""
    height: int
    """Rows [px]."""
    fx: float
    """Focal length along u [px]."""
    fy: float
    """Focal length along v [px]."""
    cx: float
    """Principal point along u [px], measured from the left edge of the image."""
    cy: float
    """Principal point along v [px], measured from the top edge of the image."""

    @classmethod
    def from_fov(cls, width: int, height: int, fov_y_rad: float) -> Intrinsics:
        """Square-pixel intrinsics of a camera with vertical field of view ``fov_y_rad`` and a centred axis."""
        f = height / 2.0 / math.tan(fov_y_rad / 2.0)
        return cls(width, height, f, f, width / 2.0, height / 2.0)


@dataclass(frozen=True)
class Pose2:
    """Where the robot's base stands, in the world."""

    x_m: float
    """World x [m]."""
    y_m: float
    """World y [m]."""
    yaw_rad: float
    """Counter-clockwise from world x, in (-pi, pi]."""

    @property
    def xy_m(self) -> Float[np.ndarray, "2"]:
        """Position as an array [m]."""
        return np.array([self.x_m, self.y_m], float)


@dataclass(frozen=True)
class Footprint:
    """The space a robot sweeps: an upright cylinder about its base."""

    radius_m: float
    """Of the cylinder [m]."""
    z_min_m: float
    """Lower obstacles do not matter [m]: the robot drives over them."""
    z_max_m: float
    """Height of the robot's top [m]."""


@dataclass(frozen=True)
class Observation:
    """What the robot perceives between two actions."""

    step: int
    """Number of actions executed before this observation; the first is 0."""
    time_s: float
    """Simulated time [s]."""
    rgb: UInt8[np.ndarray, "h w 3"]
    """Colour, row 0 at the top."""
    depth_m: Float32[np.ndarray, "h w"]
    """Planar z [m]; +inf where the sensor looked farther than its range, NaN where it measured nothing."""
    intrinsics: Intrinsics
    """Of colour and depth."""
    T_world_camera: Float[np.ndarray, "4 4"]
    """Camera to world; camera axes x right, y down, z forward."""
    pose: Pose2
    """Where the base stands, as the robot believes it."""
    range_m: float = math.inf
    """Largest planar depth that the camera measures, by its maker's word [m]; +inf where nobody says."""
    pixel_state: UInt8[np.ndarray, "h w"] | None = None
    """What each pixel is (:class:`PixelState`); None before :func:`anm_mj.sensing.pixel_state.judge_pixels`."""


@dataclass(frozen=True)
class TrueView:
    """What an observation was truly made of; for the evaluation, never for the robot."""

    pose: Pose2
    """Where the base stood."""
    T_world_camera: Float[np.ndarray, "4 4"]
    """Camera to world; camera axes x right, y down, z forward."""
    depth_m: Float32[np.ndarray, "h w"]
    """Exact planar z where the sensor gave a value [m]; not finite elsewhere."""


@dataclass(frozen=True)
class WheelSpeeds:
    """Angular velocities of the two driven wheels, positive when rolling forward."""

    left_radps: float
    right_radps: float


@dataclass(frozen=True)
class Twist:
    """A velocity of the base, in its own axes."""

    forward_mps: float
    turn_radps: float
    """Counter-clockwise."""


@dataclass(frozen=True)
class MotionResult:
    """The outcome of a motion other than a discrete action."""

    collided: bool
    """True when an obstacle prevented or stopped it."""
    wheel_speeds: WheelSpeeds
    """Mean wheel speeds over the motion [rad/s]."""
    moved_m: float
    """Length of the path of the base [m]."""
    turned_rad: float
    """Sum of all turns, to either side [rad]."""
    duration_s: float
    """Duration [s]."""
    fault: StopReason | None = None
    """Why the robot can drive no more, such as TOPPLED; None while it can."""

    @property
    def equivalent_steps(self) -> float:
        """Its cost as a number of discrete actions: its path in forward steps plus its turns in turn steps."""
        return self.moved_m / FORWARD_STEP_M + self.turned_rad / TURN_STEP_RAD


@dataclass(frozen=True)
class ActionResult:
    """The outcome of one action."""

    action: Action
    collided: bool
    """True when an obstacle prevented or stopped the move."""
    wheel_speeds: WheelSpeeds
    """Mean wheel speeds over the action [rad/s]."""
    moved_m: float
    """Distance the base moved [m]."""
    fault: StopReason | None = None
    """Why the robot can drive no more, such as TOPPLED; None while it can."""


@dataclass(frozen=True)
class VoxelGrid:
    """Free, occupied and unknown space as fused from depth."""

    state: Int8[np.ndarray, "layers rows cols"]
    """FREE, OCCUPIED or UNKNOWN; ``[layer, row, col]`` = ``[z, y, x]``."""
    seen_range_m: Float32[np.ndarray, "layers rows cols"]
    """Smallest planar depth at which a cell's surface was observed [m]; +inf where never."""
    origin_m: Float[np.ndarray, "3"]
    """World x, y, z of the outer corner of cell [0, 0, 0]."""
    resolution_m: float
    """Edge of a voxel [m]."""
    version: int = 0
    """Grows with every change."""
    column_version: Int[np.ndarray, "block_rows block_cols"] | None = None
    """The version at which a cell of each square block of columns last changed; None where nobody keeps track. Readers
    compare it with the version that they read last, see :class:`anm_mj.planning.change_reader.ChangeReader`."""

    def layer_of(self, z_m: float) -> int:
        """Index of the layer that contains a height; may lie outside the grid."""
        return math.floor((z_m - self.origin_m[2]) / self.resolution_m + _EDGE)

    def layers_between(self, low_m: float, high_m: float, *, whole: bool = False) -> slice:
        """Layers of a range of heights, as far as the grid has them.

        Args:
            low_m: lower end of the range [m].
            high_m: upper end of the range [m].
            whole: False: layers whose lower face lies in the range, so that none of an obstacle's height is missed at
                the top. True: only layers that lie in the range as a whole, so that nothing outside it counts.
        """
        first, stop = self._layer_range(low_m, high_m, whole)
        return slice(max(first, 0), max(stop, 0))

    def num_layers_between(self, low_m: float, high_m: float) -> int:
        """How many layers have their lower face in a range of heights, whether the grid has them or not."""
        first, stop = self._layer_range(low_m, high_m, whole=False)
        return stop - first

    def _layer_range(self, low_m: float, high_m: float, whole: bool) -> tuple[int, int]:
        low, high = ((z - self.origin_m[2]) / self.resolution_m for z in (low_m, high_m))
        return math.ceil(low - _EDGE), math.floor(high + _EDGE) if whole else math.ceil(high - _EDGE)


@dataclass(frozen=True)
class SurfacePoints:
    """Points on the zero-crossing of the SDF, with normals and uncertainty."""

    xyz_m: Float32[np.ndarray, "n 3"]
    """World x, y, z [m]."""
    normal: Float32[np.ndarray, "n 3"]
    """Unit normals in the world, pointing into free space."""
    uncertainty: Float32[np.ndarray, " n"]
    """A variance up to a constant factor, such as that of Eq. 4 of the paper; larger is less certain."""


@dataclass(frozen=True)
class SurfaceErrors:
    """How well the map knows its surface, point by point."""

    xyz_m: Float32[np.ndarray, "n 3"]
    """Zero-crossings, in the world."""
    error_m: Float32[np.ndarray, " n"]
    """The part of the expected distance to the true surface that more observations can take away [m]."""
    num_observations: Float32[np.ndarray, " n"]
    """Pixels of all frames that fell on the voxel about each point."""
    exponent: float
    """``error_m`` falls as ``num_observations ** -exponent``."""


@dataclass(frozen=True)
class SurfaceChange:
    """A piece of surface that is not as a former run had left it."""

    kind: str
    """``gone`` (seen through now) or ``new`` (hit where it was free)."""
    xyz_m: Float[np.ndarray, "n 3"]
    """Centres of its voxels, in the world."""
    voxel_m: float
    """Edge of a voxel [m]."""

    @property
    def box_m(self) -> Float[np.ndarray, "2 3"]:
        """Lower and upper corner of its box in the world [m]."""
        half = 0.5 * self.voxel_m
        return np.stack([self.xyz_m.min(axis=0) - half, self.xyz_m.max(axis=0) + half])


@dataclass(frozen=True)
class FormerRun:
    """What a run found out beside its map, for another one to go on from."""

    policy: str
    """Name of its policy."""
    poses: Float[np.ndarray, "n 3"]
    """Where its robot was, and those of the runs that it went on from: x [m], y [m], yaw [rad] in the world."""
    refused: Float[np.ndarray, "k 3"]
    """Poses from which a forward step met an obstacle, likewise."""
    memory: dict[str, np.ndarray] = field(default_factory=dict)
    """What its policy remembered (:meth:`anm_mj.protocols.Continues.memory`)."""


class TrainingEffort(NamedTuple):
    """Effort on one frame, in place of the schedule's."""

    iterations: int
    """Training iterations."""
    current_rays: int
    """Rays per iteration from the frame at hand, at most; the others come from keyframes."""
    is_keyframe: bool | None = None
    """Whether the frame is kept for replay; None = as the schedule says."""


@dataclass(frozen=True)
class MapUpdate:
    """The effect of one call of ``Mapper.integrate``."""

    loss: float
    """Total training loss of the last iteration; NaN when no iteration ran."""
    num_iterations: int
    num_keyframes: int


@dataclass(frozen=True)
class TopDownMap:
    """The neural map, projected to the plane that the robot moves in."""

    clearance_m: Float32[np.ndarray, "rows cols"]
    """Signed distance to the nearest obstacle or unknown-free border [m]: positive in free space, negative inside."""
    state: Int8[np.ndarray, "rows cols"]
    """FREE, OCCUPIED or UNKNOWN over the robot's body heights."""
    resolution_m: float
    """Edge of a cell [m]."""
    origin_xy_m: Float[np.ndarray, "2"]
    """World x, y of the outer corner of cell [0, 0]."""
    surface_xy_m: Float[np.ndarray, "s 2"] = field(default_factory=lambda: np.zeros((0, 2)))
    """Where free space ends at an obstacle: zero-crossings of the field, finer than a cell [m]."""
    frontier_xy_m: Float[np.ndarray, "f 2"] = field(default_factory=lambda: np.zeros((0, 2)))
    """Where free space borders on unknown space [m]."""


@dataclass(frozen=True)
class VoronoiGraph:
    """The generalized Voronoi graph of the free plane: its vertices and the safe edges between them."""

    vertex_xy_m: Float[np.ndarray, "n 2"]
    """World x, y of each vertex [m]."""
    clearance_m: Float[np.ndarray, " n"]
    """Distance of each vertex to the nearest obstacle [m]."""
    edges: Int[np.ndarray, "e 2"]
    """Vertex indices; each undirected edge once."""
    edge_length_m: Float[np.ndarray, " e"]
    """Length of each edge [m]."""

    @property
    def degree(self) -> Int[np.ndarray, " n"]:
        """Number of edges at each vertex."""
        return np.bincount(self.edges.ravel(), minlength=len(self.vertex_xy_m))


@dataclass(frozen=True)
class Region:
    """A region of interest: a cluster of uncertain surface, anchored to a vertex from which the robot can see it."""

    centre_m: Float[np.ndarray, "3"]
    normal: Float[np.ndarray, "3"]
    """Mean unit normal, pointing into free space."""
    num_members: int
    score: float
    """Mean uncertainty of the members relative to the whole surface's median."""
    vertex: int
    """Index into the graph of the same plan."""


@dataclass(frozen=True)
class Candidate:
    """One place that a policy considered, for the plan log."""

    xy_m: Float[np.ndarray, "2"]
    score: float
    gain: float
    """Gain that the policy expects there, in the policy's own unit (see its docstring)."""
    cost_steps: float
    """Steps to get there and look, including turns."""


@dataclass(frozen=True)
class UnexploredPatch:
    """A patch of unknown space that borders on free space at the end of a run."""

    centre_m: Float[np.ndarray, "3"]
    """World x, y, z [m]."""
    area_m2: float
    """Area of the border between free and unknown space [m2]."""
    why: str
    """``unreachable``, ``too narrow a way``, ``too high`` or ``hidden`` (in reach, but in no view)."""


@dataclass(frozen=True)
class Plan:
    """A policy's decision: where to go and look, or why to stop."""

    reason: str
    """Why the policy decided so, in one line for a person."""
    path_xy_m: Float[np.ndarray, "k 2"] = field(default_factory=lambda: np.zeros((0, 2)))
    """Polyline from the robot to the target [m]; empty for a turn on the spot or a stop."""
    headings_rad: tuple[float, ...] = ()
    """Yaws to turn to, in this order, after arrival."""
    actions: tuple[Action, ...] = ()
    """Actions to execute as they are (a bootstrap rotation, a random move); path and headings are then empty."""
    valid_steps: int = 0
    """The policy decides anew after this many steps, even before the robot reaches the target; 0 = not before."""
    stop: StopReason | None = None
    """Ends the run for this reason; None: go on."""
    unexplored: tuple[UnexploredPatch, ...] = ()
    """With a stop: the unexplored patches, largest first."""
    candidates: tuple[Candidate, ...] = ()
    """The places that were considered, for the log of plans."""
    topdown: TopDownMap | None = None
    """The top-down map decided on, for log, replay and film; None where the policy has none."""
    graph: VoronoiGraph | None = None
    """The Voronoi graph decided on, likewise."""
    regions: tuple[Region, ...] = ()
    """The regions of interest, likewise."""
    stage_ms: dict[str, float] = field(default_factory=dict)
    """Wall milliseconds per planning stage."""

    @property
    def target_xy_m(self) -> Float[np.ndarray, "2"] | None:
        """End of the path, or None when there is none [m]."""
        return self.path_xy_m[-1] if len(self.path_xy_m) else None
