"""Questions about the bodies of a compiled robot, and names for the unnamed elements of its spec."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np


@dataclass(frozen=True, eq=False)
class CompiledRobot:
    """A robot's spec, the model compiled from it, and its state with all poses up to date."""

    spec: mujoco.MjSpec
    model: mujoco.MjModel
    data: mujoco.MjData
    path: Path
    """The robot's file, for messages."""


def subtree(model: mujoco.MjModel, body: int) -> list[int]:
    """A body and all its descendants."""
    found = {body}
    for other in range(body + 1, model.nbody):
        if int(model.body_parentid[other]) in found:
            found.add(other)
    return sorted(found)


def joints_above(model: mujoco.MjModel, body: int) -> list[int]:
    """Joints between a body, its own included, and the world."""
    found = []
    while body:
        found += range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        body = int(model.body_parentid[body])
    return found


def solid_geoms(model: mujoco.MjModel) -> list[int]:
    """Indices of geoms that can touch something."""
    return np.flatnonzero(model.geom_contype | model.geom_conaffinity).tolist()


def unused_name(wanted: str, find: Callable[[str], Any]) -> str:
    """The wanted name, extended until ``find`` (such as ``spec.geom``) does not know it."""
    while find(wanted) is not None:
        wanted += "_"
    return wanted


def name_all(elements: Iterable[Any], kind: str) -> None:
    """Name all unnamed elements; later look-ups go by name."""
    elements = list(elements)
    taken = {element.name for element in elements}
    for number, element in enumerate(elements):
        if not element.name:
            element.name = next(name for k in range(len(taken) + 1) if (name := f"{kind}_{number + k}") not in taken)
            taken.add(element.name)
