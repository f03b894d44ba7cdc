"""Which pixels of an image truly show people, and what else is true of them at its time."""

from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32

from anm_mj.frames import pixel_directions
from anm_mj.people.crowd import Crowd
from anm_mj.people.figures import standing_bodies, states_of
from anm_mj.sim.moved_rays import MovedRays
from anm_mj.sim.render_mesh import visible_geoms
from anm_mj.types import Intrinsics, Pose2, TruePeople


class Shown(NamedTuple):
    """The pixels of an image that show what moves."""

    moving: Bool[np.ndarray, "h w"]
    """People and vacuum robots."""
    standing: Bool[np.ndarray, "h w"] | None
    """The chair and leaves of doors; None without any."""

    @property
    def any_of_them(self) -> Bool[np.ndarray, "h w"]:
        """Both."""
        return self.moving if self.standing is None else self.moving | self.standing


class PeopleShown:
    """Finds the figures of a model in its images."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Look for the figures that were added to a model."""
        geoms = visible_geoms(model, moved=True)
        stands = np.isin(model.geom_bodyid[geoms], standing_bodies(model))
        self._standing = MovedRays(model, geoms[stands]) if stands.any() else None
        self._moving = MovedRays(model, geoms[~stands])

    def find(
        self,
        data: mujoco.MjData,
        T_world_camera: Float[np.ndarray, "4 4"],
        intrinsics: Intrinsics,
        exact_m: Float32[np.ndarray, "h w"],
    ) -> Shown:
        """Where an image with this exact planar depth [m] shows them; camera axes are x right, y down, z forward.
        Poses of bodies in ``data`` are up to date.
        """
        view = data, T_world_camera, pixel_directions(intrinsics), exact_m
        return Shown(self._moving.shown(*view), None if self._standing is None else self._standing.shown(*view))


def true_people(crowd: Crowd, shown: Shown, robot: Pose2) -> TruePeople:
    """What is true of people while a robot at a pose sees so much of them."""
    states, number = states_of(crowd), crowd.config.number
    return TruePeople(
        states[:number],
        shown.moving,
        crowd.distance_m(robot.xy_m),
        chair=crowd.chair,
        standing_shown=shown.standing,
        vacuums=states[number : number + crowd.config.vacuums, :3],
        doors=crowd.doors.states,
    )
