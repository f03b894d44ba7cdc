"""What a reader found in a source: drawable submeshes, and what its format says about axes, units and licence."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Float64

from anm_mj.scene.movable import Movable
from anm_mj.scene.submesh import Submesh

UNKNOWN_LICENCE = "unknown"


@dataclass(frozen=True, eq=False)
class Joint:
    """A hinge or a slide, in the source's axes."""

    hinge: bool
    axis: Float64[np.ndarray, "3"]
    """Direction of length 1."""
    anchor_m: Float64[np.ndarray, "3"]
    """A point on a hinge's axis [m]."""
    value: float
    """Where the joint stands [rad, m]."""
    limits: tuple[float, float] | None
    """Smallest and largest value [rad, m]; None if there are none."""

    def motion(self, to: float) -> tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, "3"]]:
        """Rotation and shift that bring what hangs on the joint from where it stands to another value."""
        amount = to - self.value
        if not self.hinge:
            return np.eye(3), self.axis * amount
        x, y, z = self.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        rotation = np.eye(3) + np.sin(amount) * cross + (1.0 - np.cos(amount)) * (cross @ cross)
        return rotation, self.anchor_m - rotation @ self.anchor_m


@dataclass(frozen=True)
class ParsedScene:
    """A scene as it was read, in the source's own axes and units."""

    submeshes: list[Submesh]
    source: str
    """Where it comes from, in words: the data set and the file."""
    licence: str = UNKNOWN_LICENCE
    up: Literal["x", "y", "z"] = "z"
    """The axis that usually points up in sources of this format."""
    up_certainty: float = 1.25
    """How many times better another axis must look to be believed instead
    (:func:`anm_mj.scene.importing.canonical_axes.find_up`); infinite where the format fixes the axis."""
    scale: float | None = None
    """Metres per unit, or None to find it from the size."""
    obstacles: list[Submesh] | None = None
    """What the robot meets, where that is not what the camera sees."""
    joints: Mapping[str, Joint] = field(default_factory=dict)
    """How parts can move, by :attr:`anm_mj.scene.submesh.Submesh.part`."""
    movables: tuple[Movable, ...] = ()
    """Parts that the robot may push, in addition to their submeshes."""

    def changed(
        self,
        submesh: Callable[[Submesh], Submesh | None],
        movable: Callable[[Movable], Movable | None] = lambda own: own,
    ) -> ParsedScene:
        """The scene with every submesh, those of obstacles too, and every movable part changed, or left out by None."""
        movables = tuple(new for own in self.movables if (new := movable(own)) is not None)
        obstacles = None if self.obstacles is None else _all(submesh, self.obstacles)
        return replace(self, submeshes=_all(submesh, self.submeshes), obstacles=obstacles, movables=movables)


def _all(change: Callable[[Submesh], Submesh | None], submeshes: list[Submesh]) -> list[Submesh]:
    return [new for submesh in submeshes if (new := change(submesh)) is not None]
