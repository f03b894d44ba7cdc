"""Adds a scene's obstacles to mink's model of the robot and limits the robot's speed towards them.

mink silently drops pairs of geoms of parent and child bodies: a geom of the world and one of the robot's root body form
such a pair. Therefore the obstacles hang on a mocap body here, and a missing pair is an error.
"""

import math
from dataclasses import dataclass

import mink
import mujoco
import numpy as np
from jaxtyping import Float, Int

from anm_mj.errors import RobotError
from anm_mj.robot.compiled_robot import support_m
from anm_mj.robot.description import RobotDescription

BODY = "body"
"""Name of the cylinder that represents the robot in mink's model."""
_OBSTACLE = "obstacle_"
_SHAPES = {"SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX"}
_GAIN = 0.25
"""Largest fraction of the free distance covered in one period: the body slows down over the last centimetres, within
the braking power of the wheels."""
_NEAR_M = 0.08
"""Obstacles farther from the body cannot matter within one servo period [m]."""
_GRAZING = math.sin(math.radians(0.25))
"""Sine of the angle to an obstacle's face below which the robot drives along the face; a rounding error of its heading
does not stop it."""


@dataclass(frozen=True, eq=False)
class Obstacle:
    """One solid geom of a scene, by MuJoCo's names and in the world [m]."""

    type: mujoco.mjtGeom
    size: Float[np.ndarray, "3"]
    pos: Float[np.ndarray, "3"]
    quat: Float[np.ndarray, "4"]


def static_obstacles(model: mujoco.MjModel) -> list[Obstacle]:
    """Solid geoms that never move, without the floor (a plane)."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found = []
    for geom in range(model.ngeom):
        shape = mujoco.mjtGeom(model.geom_type[geom])
        solid = model.geom_contype[geom] or model.geom_conaffinity[geom]
        body = model.geom_bodyid[geom]
        still = model.body_weldid[body] == 0 and model.body_mocapid[body] < 0
        if solid and still and shape.name.removeprefix("mjGEOM_") in _SHAPES:
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, data.geom_xmat[geom])
            found.append(Obstacle(shape, model.geom_size[geom].copy(), data.geom_xpos[geom].copy(), quaternion))
    return found


def add_obstacles(spec: mujoco.MjSpec, robot: RobotDescription, obstacles: list[Obstacle]) -> None:
    """Add the obstacles to a reduced model's spec, and to its base the cylinder that keeps clear of them."""
    low, high = robot.footprint.z_min_m, robot.footprint.z_max_m
    spec.body("base").add_geom(
        name=BODY,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[robot.body_radius_m, (high - low) / 2.0, 0.0],
        pos=[0.0, 0.0, (low + high) / 2.0],
        mass=0.0,
    )
    static = spec.worldbody.add_body(name="obstacles", mocap=True)
    for number, obstacle in enumerate(obstacles):
        static.add_geom(name=f"{_OBSTACLE}{number}", **vars(obstacle))


class ClearanceLimit(mink.CollisionAvoidanceLimit):
    """Limits the body's speed towards obstacles, so that it stops at a distance from them."""

    def __init__(self, model: mujoco.MjModel, num_obstacles: int, *, min_distance_m: float):
        """Pair the body with every obstacle of mink's model (:func:`add_obstacles`), to stop at ``min_distance_m`` [m].
        Raises RobotError if mink has dropped a pair.
        """
        names = [f"{_OBSTACLE}{number}" for number in range(num_obstacles)]
        super().__init__(
            model,
            [([BODY], names)],
            gain=_GAIN,
            minimum_distance_from_collisions=min_distance_m,
            collision_detection_distance=_NEAR_M,
            broadphase=False,
        )
        require_all_pairs(self.geom_id_pairs, model.geom(BODY).id, [model.geom(name).id for name in names])
        self._all_pairs = np.array(sorted(self.geom_id_pairs))
        self._body = model.geom(BODY).id
        self._boxes = _bounding_rectangles(model, self._all_pairs[:, 1])
        self._reach2 = (float(model.geom_size[self._body, 0]) + _NEAR_M) ** 2
        self.is_active = False
        """Whether an obstacle was near at the last call."""

    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> mink.Constraint:
        """One inequality per obstacle near the body, on the displacement within ``dt`` [s]."""
        at = configuration.data.geom_xpos[self._body, :2]
        away = np.maximum(np.maximum(self._boxes[:, :2] - at, at - self._boxes[:, 2:]), 0.0)
        near = self._all_pairs[np.einsum("ij,ij->i", away, away) < self._reach2]
        self.is_active = len(near) > 0
        if not len(near):
            return mink.Constraint()
        # mink makes a row for each of these pairs; rows of distant obstacles would have no effect.
        self.geom_id_pairs, self.max_num_contacts = near.tolist(), len(near)
        rows = super().compute_qp_inequalities(configuration, dt)
        assert rows.G is not None
        assert rows.h is not None
        # The first two columns are the base's displacement in the world.
        ahead = configuration.data.geom_xmat[self._body].reshape(3, 3)[:2, 0]
        nearing = np.abs(rows.G[:, :2] @ ahead) > _GRAZING
        # mink bounds the displacement by a speed, which would allow 1 / dt times the distance.
        return mink.Constraint(rows.G[nearing], rows.h[nearing] * dt)


def require_all_pairs(pairs: list[tuple[int, int]], body: int, obstacles: list[int]) -> None:
    """Raises RobotError unless the body is paired with each of the obstacles."""
    missing = {(min(body, obstacle), max(body, obstacle)) for obstacle in obstacles} - set(pairs)
    if missing:
        raise RobotError(
            f"mink leaves {len(missing)} of {len(obstacles)} obstacles out of its clearance limit; obstacles must hang "
            "on a body that is neither the world nor the robot's, and collide with the robot."
        )


def _bounding_rectangles(model: mujoco.MjModel, geoms: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n 4"]:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    directions = np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    reach = np.array([support_m(model, data, int(geom), directions) for geom in geoms])
    return reach.reshape(-1, 4) * (-1.0, -1.0, 1.0, 1.0)
