"""The seams between the stages: plug-in interface, test seam and real-robot seam at once.

Any object with these methods will do; nothing has to be inherited or registered. ``explore`` sees the stages through
these only.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32

from anm_mj.types import (
    Action,
    ActionResult,
    Footprint,
    MapUpdate,
    MotionResult,
    Observation,
    Plan,
    Pose2,
    SurfacePoints,
    Twist,
    VoxelGrid,
)


@runtime_checkable
class Robot(Protocol):
    """A body with an RGB-D camera that obeys discrete actions and velocities, simulated or real."""

    @property
    def footprint(self) -> Footprint:
        """The cylinder that must stay clear of obstacles."""
        ...

    def observe(self) -> Observation:
        """The view from where the robot stands now."""
        ...

    def act(self, action: Action) -> ActionResult:
        """Execute one action to its end and say what came of it."""
        ...

    def drive(self, twist: Twist, duration_s: float) -> MotionResult:
        """Move at a velocity for a time [s] and say what came of it."""
        ...


@runtime_checkable
class Drive(Protocol):
    """Turns what is asked of a simulated robot into wheel motion."""

    def act(self, action: Action) -> ActionResult:
        """Execute one action to its end and say what came of it."""
        ...

    def drive(self, twist: Twist, duration_s: float) -> MotionResult:
        """Move at a velocity for a time [s]; without a next call the robot does not go on."""
        ...

    def look_at(self, point_m: Float[np.ndarray, "3"]) -> MotionResult:
        """Turn on the spot until the camera's axis lies in one vertical plane with a point of the world."""
        ...

    def place(self, pose: Pose2) -> None:
        """Stand the robot at a pose, at rest; obstacles are not asked."""
        ...

    @property
    def pose(self) -> Pose2:
        """Where the base stands now."""
        ...

    @property
    def odometry(self) -> Pose2:
        """Where the base stands as far as the wheels' encoders tell."""
        ...


@runtime_checkable
class Mapper(Protocol):
    """The map of the scene, learnt online: a neural field and, beside it, an occupancy grid."""

    def integrate(self, observation: Observation) -> MapUpdate:
        """Take one observation in and train as the schedule says."""
        ...

    def sdf(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """Signed distance to the nearest surface at world points, truncated [m]; positive in free space."""
        ...

    def uncertainty(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """How unsure the map is at world points: a variance up to a constant factor; larger is less certain."""
        ...

    def surface(self, centre_xy_m: Float[np.ndarray, "2"], radius_m: float) -> SurfacePoints:
        """Zero-crossings of the SDF within ``radius_m`` (in the plane) of a place, where anything was observed."""
        ...

    @property
    def occupancy(self) -> VoxelGrid:
        """Free, occupied and unknown space as fused from depth so far (a view, not a copy)."""
        ...


@runtime_checkable
class Policy(Protocol):
    """Decides where to go and look next."""

    def observe(self, observation: Observation) -> None:
        """Take in an observation; the first one comes before any action, one more after every action."""
        ...

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The next decision, made from the map and the robot's pose."""
        ...

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Learn that ``action`` at ``pose`` met an obstacle."""
        ...


@runtime_checkable
class Recorder(Protocol):
    """Keeps what a run does as it does it."""

    def observation(self, observation: Observation) -> None:
        """An observation has been made; the first one stands before any action."""
        ...

    def step(self, step: int, result: ActionResult, pose: Pose2, update: MapUpdate, stage_ms: dict[str, float]) -> None:
        """An action has been executed; ``pose`` is where the robot stands after it."""
        ...

    def plan(self, step: int, plan: Plan) -> None:
        """A decision has been made."""
        ...


@runtime_checkable
class Viewer(Protocol):
    """Shows a run while it goes."""

    def show(self, observation: Observation, mapper: Mapper, plan: Plan | None) -> None:
        """Show the present state; must return quickly and never stop the run."""
        ...

    def close(self) -> None:
        """Free ports and processes."""
        ...
