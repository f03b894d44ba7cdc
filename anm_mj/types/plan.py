"""What planning reads out of the map, and decides."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int8

from anm_mj.types.motion import Action, StopReason


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
    no_floor: Bool[np.ndarray, "rows cols"] | None = None
    """Where a view went through to below the floor, or a camera looked for it in vain: a drop, and what lies beyond it;
    None where nobody knows."""


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
class TargetOutcome:
    """What a target was expected to bring, and what it did bring by the time that the policy closed it."""

    xy_m: Float[np.ndarray, "2"]
    kind: str
    """The kind of place that most was expected of, in the policy's own words."""
    promised_m2: float
    """New surface that the policy expected of it, and of the turns to it, when it chose it [m2]."""
    expected_m2: float
    """The part of that which the policy expected of what the robot then looked at [m2]."""
    realised_m2: float
    """New surface that was seen between its choice and its end, on the way too [m2]."""
    judged: bool
    """False for a target that was left on the way for a better one, while most of its view was still expected."""


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
    """The policy decides again after this many steps, even before the robot reaches the target; 0 = not before."""
    stop: StopReason | None = None
    """Ends the run for this reason; None: go on."""
    unexplored: tuple[UnexploredPatch, ...] = ()
    """With a stop: the unexplored patches, largest first."""
    candidates: tuple[Candidate, ...] = ()
    """The places that were considered, for the log of plans."""
    closed: TargetOutcome | None = None
    """The target that this decision has closed, for the log of plans."""
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
