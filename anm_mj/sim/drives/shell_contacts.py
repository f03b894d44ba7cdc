"""What the robot's shell touches: everything of it but wheels and casters."""

import math

import mujoco
import numpy as np

from anm_mj.robot.base_joints import PlanarBase, SimulatedBase, element_id

_BLOCKING_COS = 0.25
"""A contact blocks a forward motion if the cosine between the heading and its outward normal is larger; along contacts
at its side the robot slides."""


class ShellContacts:
    """The contacts between a robot's shell and everything else."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, shell: list[str]):
        """Look the shell's geoms up by name. Raises RobotError if a geom is missing."""
        self._data = data
        self._is_shell = np.zeros(model.ngeom, dtype=bool)
        self._is_shell[[element_id(model, mujoco.mjtObj.mjOBJ_GEOM, name) for name in shell]] = True
        root = model.body_rootid[model.geom_bodyid]
        moves = model.body_weldid[model.geom_bodyid] != 0
        self._is_movable = moves & ~np.isin(root, root[self._is_shell])

    def any(self) -> bool:
        """Whether the shell touches anything."""
        near = self._is_shell[self._data.contact.geom]
        return bool((near[:, 0] != near[:, 1]).any())

    def blocks(self, base: SimulatedBase | PlanarBase) -> bool:
        """Whether the shell touches something in the direction of a base's heading that cannot be pushed."""
        touching = self._is_shell[self._data.contact.geom]
        if not touching.any():
            return False
        yaw_rad = base.pose.yaw_rad
        for contact, (first_is_robot, second_is_robot) in zip(self._data.contact, touching, strict=True):
            if first_is_robot == second_is_robot or contact.dist > 0.0:
                continue
            # What gives way is pushed; what is too heavy stops the base, which then lags its reference.
            if self._is_movable[contact.geom[1 if first_is_robot else 0]]:
                continue
            # The contact's normal points from its first geom to its second.
            outwards = contact.frame[:2] if first_is_robot else -contact.frame[:2]
            if outwards[0] * math.cos(yaw_rad) + outwards[1] * math.sin(yaw_rad) > _BLOCKING_COS:
                return True
        return False
