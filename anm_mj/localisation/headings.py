"""What walls say of a camera's heading, for its registration."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from anm_mj.localisation.se3 import rotation_vector


class HeadingSums(NamedTuple):
    """Of a pose's rotation about the vertical."""

    information: float
    """[1/rad^2]"""
    slope: float
    """[1/rad]"""
    cost: float
    """Robust, in squared standard deviations."""


@dataclass(frozen=True)
class Headings:
    """What walls say of a camera's heading."""

    T_world_camera: Float[np.ndarray, "4 4"]
    """The pose that headings are counted from."""
    turns_rad: tuple[float, ...]
    """By how much each wall has the camera turned from there, about the vertical."""
    deviations_rad: tuple[float, ...]
    """Standard deviations of these."""
    kernels: tuple[float, float]
    """Widths of Geman and McClure's kernel at first and at the end of a search [standard deviations]."""

    def sums(self, T_world_camera: Float[np.ndarray, "4 4"], share: float = 1.0) -> HeadingSums:
        """What a pose's heading costs, and which way it costs less, a share in [0, 1] of the way between kernels."""
        first, last = self.kernels
        kernel = first * (last / first) ** share
        turned = turned_rad(self.T_world_camera, T_world_camera)
        information = slope = cost = 0.0
        for turn, deviation in zip(self.turns_rad, self.deviations_rad, strict=True):
            off = (turned - turn) / deviation
            kept = kernel**2 / (kernel**2 + off**2)
            information += (kept / deviation) ** 2
            slope += kept**2 * off / deviation
            cost += kept * off**2
        return HeadingSums(information, slope, cost)


def turned_rad(T_from: Float[np.ndarray, "4 4"], T_to: Float[np.ndarray, "4 4"]) -> float:
    """By how much a pose is turned from another one about the vertical."""
    return float(rotation_vector(T_to[:3, :3] @ T_from[:3, :3].T)[2])
