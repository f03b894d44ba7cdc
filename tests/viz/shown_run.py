"""A run in a box, as a live view is told of it."""

from typing import Any

import trimesh

from anm_mj.evaluation.completion_curve import CurveRow
from anm_mj.io.run_events import Mapped
from anm_mj.types import Pose2
from tests.box_room import FakeMap, observe, room_plan


class CountingMap(FakeMap):
    """A whole mapper as far as types go; only its mesh is asked for."""

    num_meshes = 0
    truncation_m = 0.1

    def __init__(self):
        self.reused = []

    def mesh(self, resolution_m: float, *, reuse: bool = False) -> trimesh.Trimesh:
        self.num_meshes += 1
        self.reused.append(reuse)
        return super().mesh(resolution_m)

    def integrate(self, *args: Any) -> Any:
        raise AssertionError("the viewer asks for the mesh only")

    sdf = uncertainty = surface = occupancy_grid = integrate
    occupancy = None


def completed(step, percent):
    return CurveRow(step, percent / 2, 50.0, percent, 1.0)


def show(viewer, num_steps, mapper=None, first=0):
    plan = room_plan()
    for step in range(first, first + num_steps):
        viewer.show(observe(step, Pose2(0.01 * step, 0.0, 0.0)), mapper or CountingMap(), plan)


def mapped(step):
    mapper: Any = CountingMap()
    return Mapped(observe(step, Pose2(0.3, 0.0, 0.0)), mapper, None)
