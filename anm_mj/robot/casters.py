"""Casters: what of a robot stands on the floor beside its driven wheels slides there without friction."""

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.errors import RobotError
from anm_mj.robot.body_tree import CompiledRobot, unused_name
from anm_mj.robot.geom_extent import height_range_m

TOUCHES_FLOOR_M = 0.005
"""Geoms that begin below this height roll or slide on the floor: wheels and casters [m]."""
_SINKS_M = 2e-4
"""A caster that reaches farther below the wheels would carry the robot instead of them [m]."""
_TOO_LOW_M = 0.03
"""What reaches farther below the wheels is no caster [m]."""
_SPHERE_M = 0.008


def let_casters_slide(
    robot: CompiledRobot, casters: list[int], root: str, T_world_base: Float[np.ndarray, "4 4"]
) -> list[str]:
    """Remove the friction of caster geoms, whatever the friction of the floor; what was changed besides.

    Suspensions are locked, so a caster that reaches below the wheels would lift them. A small sphere that ends on the
    floor replaces its contact. Raises RobotError if something reaches far below the wheels.
    """
    spec, model, data, shortened = robot.spec, robot.model, robot.data, []
    for caster in casters:
        name = model.geom(caster).name
        geom = spec.geom(name)
        sinks_m = float(T_world_base[2, 3]) - height_range_m(model, data, caster)[0]
        if sinks_m > _TOO_LOW_M:
            raise RobotError(
                f"The geom {name} of {robot.path} reaches {100 * sinks_m:.1f} cm below the wheels, so that they do not "
                "touch the floor; raise it, or name the wheels that the robot stands on by --set "
                "model.left_wheel=NAME --set model.right_wheel=NAME."
            )
        geom.condim, geom.priority = 1, max(geom.priority, 1)
        if sinks_m > _SINKS_M:
            geom.contype = geom.conaffinity = 0
            place = np.append(lowest_xy_m(model, data, caster), T_world_base[2, 3] + _SPHERE_M)
            body = model.body(root).id
            local = data.xmat[body].reshape(3, 3).T @ (place - data.xpos[body])
            spec.body(root).add_geom(
                name=unused_name(f"{name}_contact", spec.geom),
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[_SPHERE_M, 0.0, 0.0],
                pos=local,
                condim=1,
                priority=max(int(geom.priority), 1),
                mass=0.0,
                group=4,
            )
            shortened.append(f"{name} (by {1000 * sinks_m:.1f} mm)")
    return [f"casters shortened to the height of the wheels: {', '.join(shortened)}"] if shortened else []


def lowest_xy_m(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Float[np.ndarray, "2"]:
    """Where a geom touches the floor [m]: the mean of a mesh's lowest vertices, else below its centre."""
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        world = model.mesh_vert[first : first + count] @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        return world[world[:, 2] < world[:, 2].min() + 1e-3, :2].mean(axis=0)
    return data.geom_xpos[geom, :2].copy()
