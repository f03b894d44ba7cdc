"""Where everything was in the last moments: what an image shows that arrives late."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.control.action_motion import Trapezoid
from anm_mj.frames import wrap_angle
from anm_mj.types import Pose2

if TYPE_CHECKING:
    from anm_mj.people.crowd import Crowd
    from anm_mj.people.figures import Figures


_Moment = tuple[float, Float[np.ndarray, " q"], Pose2, Trapezoid | None]
"""A plain tuple, as checkpoints hold them: time [s]; positions of the joints; pose of the base as the encoders have it;
profile of the motion since the moment before, None = at a constant velocity."""


class Trail:
    """Keeps the state of a simulation and the readings of its wheels for a while; a copy goes on by itself.

    Between two moments the joints move along the shortest way, as a base does that drives straight or turns on the
    spot. People stand from each of their periods to the next one.
    """

    REBUILT = ("_model",)

    def __init__(self, model: mujoco.MjModel, reach_s: float) -> None:
        """Keep what was up to so long ago [s]."""
        self._model, self._reach_s = model, reach_s
        self.restart()

    def restart(self) -> None:
        """Forget everything: the robot was put elsewhere."""
        self._moments: list[_Moment] = []
        self._people: list[tuple[float, np.ndarray, np.ndarray]] = []
        """From when on people and things stood so: time [s], and poses of their bodies."""

    def copied(self) -> Trail:
        """The same past, with a future of its own."""
        other = copy.copy(self)
        other._moments, other._people = list(self._moments), list(self._people)
        return other

    def add(self, data: mujoco.MjData, odometry: Pose2, profile: Trapezoid | None = None) -> None:
        """Take in the present state of the simulation, unless no time has passed since the last one.

        ``odometry`` is the pose of the base by the encoders alone, ``profile`` that of the motion since the last
        moment; None = at a constant velocity.
        """
        if not self._people:
            self._add_people(data.time, data)
        if self._moments and data.time <= self._moments[-1][0]:
            return
        self._moments.append((data.time, data.qpos.copy(), odometry, profile))
        oldest_s = data.time - self._reach_s
        while len(self._moments) > 1 and self._moments[1][0] <= oldest_s:
            del self._moments[0]
        while len(self._people) > 1 and self._people[1][0] <= oldest_s:
            del self._people[0]

    def follow(self, crowd: Crowd, figures: Figures, data: mujoco.MjData, robot_xy_m: Float[np.ndarray, "2"]) -> None:
        """Let people move on to the present time of the simulation; arguments as of :meth:`Crowd.follow`."""
        while (now_s := crowd.next_s) <= data.time + 1e-9:
            crowd.follow(now_s, robot_xy_m)
            figures.write(crowd, data)
            self._add_people(now_s, data)

    def odometry_at(self, time_s: float) -> Pose2:
        """Pose of the base at a time of the past [s], as the encoders have it; at the ends of what is kept, the end."""
        (_, _, a, _), (_, _, b, _), share = self._around(time_s)
        turned_rad = share * wrap_angle(b.yaw_rad - a.yaw_rad)
        x_m, y_m = a.x_m + share * (b.x_m - a.x_m), a.y_m + share * (b.y_m - a.y_m)
        return Pose2(x_m, y_m, wrap_angle(a.yaw_rad + turned_rad))

    def write(self, data: mujoco.MjData, time_s: float) -> None:
        """Write the positions of everything at a time of the past [s] into other data of the model."""
        (_, before, _, _), (_, after, _, _), share = self._around(time_s)
        motion = np.zeros(self._model.nv)
        mujoco.mj_differentiatePos(self._model, motion, 1.0, before, after)
        data.qpos[:] = before
        mujoco.mj_integratePos(self._model, data.qpos, motion, share)
        _, position, rotation = next((one for one in self._people[::-1] if one[0] <= time_s), self._people[0])
        data.mocap_pos[:], data.mocap_quat[:] = position, rotation

    def _around(self, time_s: float) -> tuple[_Moment, _Moment, float]:
        """The moments before and after a time, and how much of the motion between them was done."""
        after = next((k for k, one in enumerate(self._moments) if one[0] > time_s), len(self._moments))
        if after in (0, len(self._moments)):
            end = self._moments[0 if after == 0 else -1]
            return end, end, 0.0
        before, then = self._moments[after - 1 : after + 1]
        passed_s, profile = time_s - before[0], then[3]
        return before, then, passed_s / (then[0] - before[0]) if profile is None else profile.fraction(passed_s)

    def _add_people(self, time_s: float, data: mujoco.MjData) -> None:
        self._people.append((time_s, data.mocap_pos.copy(), data.mocap_quat.copy()))
