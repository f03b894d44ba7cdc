"""A compass made of walls: those of a building share few directions, so each one seen tells the heading.

A direction is learnt from the first walls that have it. Whatever is parallel to it later holds the heading to where it
was then, however far the robot has gone: registration alone lets it drift with every new surface. Nothing is assumed
of angles between walls. Source of the idea: Straub, Bhandari, Leonard and Fisher, Real-time Manhattan World Rotation
Estimation in 3D, IROS 2015, here without its Manhattan world.
"""

import math
import statistics
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64

from anm_mj.localisation.localisation_config import CompassConfig
from anm_mj.localisation.registration import Prior, is_planar
from anm_mj.localisation.wall_directions import Headings, turned_rad, wall_directions
from anm_mj.types import Observation

_RESIDUALS = 60
"""So many of the last ones tell how far walls deviate from their directions."""
_PREVAILS = 2
"""A direction tells headings if it was seen more than so many times as often as every other one near it."""


@dataclass
class _Direction:
    """Of parallel walls."""

    angle_rad: float
    """Mean of the first ones seen."""
    weight: float
    """Sum of what they weigh in it [1/rad^2]."""
    information: float
    """Of their noise alone [1/rad^2]."""
    pose_rad: float
    """Smallest standard deviation of a heading that they were seen from: headings of one way err alike."""
    num_walls: int = 1

    @property
    def variance(self) -> float:
        """Of the mean [rad^2]."""
        return 1.0 / self.information + self.pose_rad**2


class WallCompass:
    """Learns the directions of walls, and tells headings by them."""

    def __init__(self, config: CompassConfig, basis: Float64[np.ndarray, "6 k"]) -> None:
        """Before any frame; without ``PLANAR`` directions of motion it says nothing."""
        self._config = config
        self._is_on = config.is_on and is_planar(basis)
        self._directions: list[_Direction] = []
        self._seen: tuple[Float[np.ndarray, "4 4"], list[tuple[float, float]]] | None = None
        """Of the last frame: a pose, and angles of walls as seen from it, with what noise makes of them [rad]."""
        self._residuals: list[float] = []
        """Of the last walls, in stated standard deviations."""

    def look(self, view: Observation, prior: Prior, noise_per_m: float) -> Prior:
        """The prior with what the walls in a frame, without pixels that moved, say of its heading. The deviation of the
        sensor's depth is ``noise_per_m`` times its square [1/m].
        """
        if not self._is_on:
            return prior
        config, scale, T_world_camera = self._config, self._scale, prior.T_world_camera
        found = wall_directions(view.depth_m, view.intrinsics, T_world_camera[:3, :3], noise_per_m)
        seen = [(wall.angle_rad, config.noise_share * wall.deviation_rad) for wall in found]
        self._seen = T_world_camera, [each for each in seen if each[1] <= config.most_deviation_rad]
        turns, deviations = list[float](), list[float]()
        for angle, noise in self._seen[1]:
            for direction in self._directions:
                deviation = math.sqrt(scale**2 * (noise**2 + config.deviation_rad**2) + direction.variance)
                reach = min(config.reach_deviations * math.hypot(prior.deviations[1], deviation), config.most_turn_rad)
                turn = _half_turn(direction.angle_rad - angle)
                if abs(turn) < reach and self._prevails(direction):
                    turns.append(turn)
                    deviations.append(deviation)
        if not turns:
            return prior
        kernels = config.first_kernel, config.kernel
        return replace(prior, headings=Headings(T_world_camera, tuple(turns), tuple(deviations), kernels))

    def learn(self, T_world_camera: Float[np.ndarray, "4 4"], deviation_rad: float) -> None:
        """Take in the walls of the last frame, at the pose that was found for it, whose rotation in the world has a
        standard deviation of ``deviation_rad``.
        """
        if self._seen is None:
            return
        config, turned = self._config, turned_rad(self._seen[0], T_world_camera)
        for seen_rad, noise in self._seen[1]:
            angle, weight = seen_rad + turned, 1.0 / (noise**2 + deviation_rad**2)
            off, nearest = min(
                ((_half_turn(angle - each.angle_rad), each) for each in self._directions),
                key=lambda pair: abs(pair[0]),
                default=(math.inf, None),
            )
            if nearest is None or abs(off) > config.apart_rad:
                self._directions.append(_Direction(angle, weight, noise**-2, deviation_rad))
                continue
            if nearest.num_walls < config.learn_walls:
                nearest.weight += weight
                nearest.angle_rad += off * weight / nearest.weight
                nearest.information += noise**-2
                nearest.pose_rad = min(nearest.pose_rad, deviation_rad)
            nearest.num_walls += 1
            self._residuals = [*self._residuals, abs(off) / math.hypot(noise, config.deviation_rad)][-_RESIDUALS:]
        self._seen = None

    def _prevails(self, direction: _Direction) -> bool:
        """Whether no other direction is so near, and so frequent, that this one may be a mixture of walls."""
        return all(
            direction.num_walls > _PREVAILS * each.num_walls
            for each in self._directions
            if each is not direction and abs(_half_turn(each.angle_rad - direction.angle_rad)) < self._config.alone_rad
        )

    @property
    def _scale(self) -> float:
        """How much farther walls deviate from their directions than stated, at least 1."""
        if len(self._residuals) < _RESIDUALS // 2:
            return 1.0
        return max(1.0, statistics.median(self._residuals) / 0.6745)


def _half_turn(angle_rad: float) -> float:
    """The angle between two lines, in [-pi/2, pi/2)."""
    return (angle_rad + math.pi / 2) % math.pi - math.pi / 2
