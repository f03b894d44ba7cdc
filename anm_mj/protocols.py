"""The interfaces between the stages: plug-ins, tests and real robots all use them.

Any object with these methods will do; there is nothing to inherit or register. ``explore`` sees the stages through
these interfaces only.
"""

import math
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32

from anm_mj.types import (
    Action,
    ActionResult,
    ExploredState,
    Footprint,
    MapUpdate,
    MotionResult,
    Observation,
    OccupancyGrid,
    Plan,
    Pose2,
    SurfaceErrors,
    SurfacePoints,
    Twist,
)


@runtime_checkable
class Robot(Protocol):
    """A robot with an RGB-D camera that executes discrete actions and velocities, simulated or real."""

    @property
    def footprint(self) -> Footprint:
        """The cylinder to keep clear of obstacles."""
        ...

    def observe(self) -> Observation:
        """The view from the present pose."""
        ...

    def act(self, action: Action) -> ActionResult:
        """Execute one action to its end."""
        ...

    def drive(self, twist: Twist, duration_s: float) -> MotionResult:
        """Move at a velocity for a time [s]."""
        ...


@runtime_checkable
class Anticipates(Protocol):
    """A robot that can begin with what comes after actions before they are executed."""

    def anticipate(self, *actions: Action) -> None:
        """Begin to see what the next actions will show, each after those before it, and return at once.

        Nothing changes if others are executed. A later call goes on from the state of then.
        """
        ...


@runtime_checkable
class Drive(Protocol):
    """Turns the actions and velocities of a simulated robot into wheel motion."""

    def act(self, action: Action) -> ActionResult:
        """Execute one action to its end."""
        ...

    def drive(self, twist: Twist, duration_s: float) -> MotionResult:
        """Move at a velocity for a time [s]; the robot stops unless another call follows."""
        ...

    def look_at(self, point_m: Float[np.ndarray, "3"]) -> MotionResult:
        """Turn on the spot until a vertical plane holds both the camera's axis and a point of the world [m]."""
        ...

    def place(self, pose: Pose2) -> None:
        """Put the robot at a pose, at rest, regardless of obstacles."""
        ...

    def reseed(self, seed: int) -> None:
        """Begin the errors of the wheel encoders of a seed."""
        ...

    @property
    def pose(self) -> Pose2:
        """The true pose of the base."""
        ...

    @property
    def odometry(self) -> Pose2:
        """The pose of the base as the wheel encoders have it."""
        ...


@runtime_checkable
class Mapper(Protocol):
    """The map of the scene, learnt online: a neural field and an occupancy grid."""

    def integrate(self, observation: Observation) -> MapUpdate:
        """Add an observation and train for the iterations that the schedule sets."""
        ...

    @property
    def truncation_m(self) -> float:
        """Distance from surface beyond which the SDF says no more than 'far' [m]."""
        ...

    def sdf(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """Signed distance to the nearest surface at world points, truncated to +-``truncation_m`` [m].

        It is positive in free space.
        """
        ...

    def uncertainty(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """Uncertainty of the map at world points: a variance up to a constant factor; larger is less certain."""
        ...

    def surface(
        self, centre_xy_m: Float[np.ndarray, "2"], radius_m: float, max_height_m: float = math.inf
    ) -> SurfacePoints:
        """Zero-crossings of the SDF in observed space within ``radius_m`` (in the plane) of a place.

        Those above ``max_height_m`` are left out.
        """
        ...

    def occupancy_grid(
        self, centre_xy_m: Float[np.ndarray, "2"] | None = None, radius_m: float = math.inf
    ) -> OccupancyGrid:
        """Free, occupied and unknown space, fused from depth (views, not copies).

        It has to be of now only within ``radius_m`` [m] of a place along both axes; None = everywhere.
        """
        ...


@runtime_checkable
class EstimatesErrors(Protocol):
    """A mapper that also knows how badly it knows its surface; without one, runs end when nothing new is left."""

    def surface_errors(self, centre_xy_m: Float[np.ndarray, "2"], radius_m: float) -> SurfaceErrors:
        """Expected errors at the zero-crossings within ``radius_m`` (in the plane) of a place."""
        ...


@runtime_checkable
class FindsMoved(Protocol):
    """A mapper that knows which pixels show something that moves."""

    def find_moved(self, observation: Observation) -> Observation:
        """The frame with the depth of moved pixels apart from the other, as far as the map knows before it."""
        ...

    def hold_moved(self, discs: Float[np.ndarray, "n 3"]) -> None:
        """Take what the last frame showed to move for an obstacle, and discs, until it is looked through or released.

        A disc stands at x and y and has a radius [m].
        """
        ...

    def release_moved(self) -> bool:
        """Take nothing that moved for an obstacle any more; whether anything was."""
        ...

    def doubt_moved(self) -> bool:
        """Take for free space what may be left of something that moved, until a frame shows what is there; whether
        there was any that had not been doubted before.
        """
        ...


@runtime_checkable
class Policy(Protocol):
    """Decides where to go and look next."""

    def observe(self, observation: Observation) -> None:
        """Take in an observation whose pose is good enough for the map: one before any action, one more after each."""
        ...

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The next decision, from the map and the robot's pose."""
        ...

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Learn that ``action`` at ``pose`` met an obstacle."""
        ...


@runtime_checkable
class Continues(Protocol):
    """A policy that can begin with what a prior run explored; another one knows it through the map alone."""

    def memory(self) -> dict[str, np.ndarray]:
        """What it has found out beside the map, as numbers, for a later run of the same policy."""
        ...

    def continue_from(self, prior: ExploredState, mapper: Mapper) -> None:
        """Take over what a prior run explored, before the first observation; the mapper holds its map."""
        ...
