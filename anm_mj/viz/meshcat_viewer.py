"""A run in the browser while it goes: the growing mesh, robot, way, graph, regions, target and path."""

from __future__ import annotations

import getpass
import logging
import socket
import time
from typing import Protocol, runtime_checkable

import numpy as np
import trimesh
from jaxtyping import Float
from meshcat.commands import SetObject, SetProperty, SetTransform
from meshcat.geometry import Object
from meshcat.path import Path

from anm_mj.frames import pose_matrix
from anm_mj.protocols import Mapper
from anm_mj.types import Observation, Plan
from anm_mj.viz import shapes
from anm_mj.viz.page_server import FIRST_PORT, PageServer

logger = logging.getLogger(__name__)

MESH_SHARE = 0.05
"""Largest share of the run's time that making meshes for the view may take."""
MESH_EVERY_STEPS = 20
MESH_RESOLUTION_M = 0.1
WAY_PIECE_STEPS = 50
"""The way is sent in pieces of this many steps, so that a step costs the same however long the run is."""
BODY, SIGHT, WAY, GRAPH, REGIONS, TARGET, PATH = 0x4A5568, 0x2B6CA3, 0x7A3FA0, 0x3B8A5A, 0xE08A1E, 0xC8323C, 0xC8323C
"""Colours: of the robot, what its camera sees, where it has been, and what is planned."""


@runtime_checkable
class Meshable(Protocol):
    """A map that can show its surface."""

    def mesh(self, resolution_m: float, *, reuse: bool) -> trimesh.Trimesh:
        """The surface as a coloured mesh, world [m]; with ``reuse``, new only where frames have come in since."""
        ...


class MeshcatViewer:
    """Shows a run on a web page of this machine; a run goes on whether anybody watches or not.

    The mesh is made anew only while a browser looks, at most every 20 steps, and seldom enough to take no more than
    5 % of the run's time.

    Args:
        port: The first port to try; the next free one is taken. None starts at 7000.

    Raises:
        RenderError: No port is free.
    """

    def __init__(self, port: int | None = None) -> None:
        self._server = PageServer(FIRST_PORT if port is None else port)
        self._failed = False
        self._way: list[Float[np.ndarray, "2"]] = []
        self._plan: Plan | None = None
        self._begin_s = time.perf_counter()
        self._mesh_s = 0.0
        self._mesh_step: int | None = None
        logger.info("Watch the run at %s", self._server.url)
        there = f"{getpass.getuser()}@{socket.gethostname()}"
        port = self._server.port
        logger.info("From another machine, run there first: ssh -L %d:127.0.0.1:%d %s", port, port, there)

    @property
    def url(self) -> str:
        """Where the page is."""
        return self._server.url

    def show(self, observation: Observation, mapper: Mapper, plan: Plan | None) -> None:
        """Show the present state; returns quickly, and a failure ends the view but not the run."""
        if self._failed:
            return
        try:
            if not self._way:
                self._set_stage(observation)
            self._show_robot(observation)
            if plan is not None and plan is not self._plan:
                self._show_plan(plan)
            if isinstance(mapper, Meshable) and self._mesh_is_due(observation.step):
                self._show_mesh(mapper, observation.step)
        except Exception:
            # The view is a window on the run; whatever breaks in it must not break the run.
            logger.exception("The live view is off from here on; the run goes on.")
            self._failed = True

    def close(self) -> None:
        """Free the port; a second time does nothing."""
        self._server.close()

    def _set_stage(self, observation: Observation) -> None:
        pose, camera = observation.pose, observation.T_world_camera
        self._property("/Background", "top_color", [1.0, 1.0, 1.0])
        self._property("/Background", "bottom_color", [0.90, 0.91, 0.93])
        self._property("/Axes", "visible", False)
        self._property("/Grid", "visible", False)
        self._centre(pose.xy_m)
        # In the camera's own frame y is up: seen from the south, steeply from above.
        self._property("/Cameras/default/rotated/<object>", "position", [0.0, 9.0, 5.0])
        self._object("robot", shapes.robot_body(float(camera[2, 3]), BODY))
        self._object("camera", shapes.camera_frustum(observation.intrinsics, SIGHT))
        self._object("target", shapes.target_mark(TARGET))
        self._property("/meshcat/target", "visible", False)

    def _show_robot(self, observation: Observation) -> None:
        self._transform("/meshcat/robot", pose_matrix(observation.pose))
        self._transform("/meshcat/camera", observation.T_world_camera)
        self._way.append(observation.pose.xy_m)
        piece = (len(self._way) - 1) // WAY_PIECE_STEPS
        since = np.array(self._way[max(0, piece * WAY_PIECE_STEPS - 1) :])
        self._object(f"way/{piece}", shapes.ribbon(since, shapes.WAY_HEIGHT_M, shapes.WAY_WIDTH_M, WAY))

    def _show_plan(self, plan: Plan) -> None:
        self._plan = plan
        if plan.graph is not None:
            self._object("graph", shapes.graph_bands(plan.graph, GRAPH))
            self._object("regions", shapes.region_marks(plan.regions, REGIONS))
        self._object("path", shapes.ribbon(plan.path_xy_m, shapes.PATH_HEIGHT_M, shapes.PATH_WIDTH_M, PATH))
        target = plan.target_xy_m
        self._property("/meshcat/target", "visible", target is not None)
        if target is not None:
            self._transform("/meshcat/target", trimesh.transformations.translation_matrix([*target, 0.0]))

    def _mesh_is_due(self, step: int) -> bool:
        if self._server.num_browsers == 0:
            return False
        if self._mesh_step is None:
            return True
        affordable = self._mesh_s <= MESH_SHARE * (time.perf_counter() - self._begin_s)
        return affordable and step - self._mesh_step >= MESH_EVERY_STEPS

    def _show_mesh(self, mapper: Meshable, step: int) -> None:
        begin_s = time.perf_counter()
        self._mesh_step = step
        mesh = mapper.mesh(MESH_RESOLUTION_M, reuse=True)
        if len(mesh.faces):
            self._object("mesh", shapes.neural_surface(mesh))
            self._centre(np.asarray(mesh.bounds).mean(axis=0)[:2])
        self._mesh_s += time.perf_counter() - begin_s

    def _centre(self, xy_m: Float[np.ndarray, "2"]) -> None:
        # The page's camera turns about the origin and nothing else, so the world is moved under it.
        self._transform("/meshcat", trimesh.transformations.translation_matrix([-xy_m[0], -xy_m[1], 0.0]))

    def _object(self, name: str, thing: Object) -> None:
        self._server.publish(SetObject(thing, path=_path(f"/meshcat/{name}")))

    def _transform(self, path: str, T: Float[np.ndarray, "4 4"]) -> None:
        self._server.publish(SetTransform(T, _path(path)))

    def _property(self, path: str, key: str, value: object) -> None:
        self._server.publish(SetProperty(key, value, _path(path)))


def _path(path: str) -> Path:
    return Path(tuple(path.strip("/").split("/")))
