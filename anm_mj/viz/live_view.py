"""Live view of a run in a browser: mesh, robot, trajectory, Voronoi graph, regions of interest, target and path."""

import getpass
import logging
import shlex
import socket
import threading
import time
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
import trimesh
from jaxtyping import Float, UInt8
from meshcat.commands import SetObject, SetProperty, SetTransform
from meshcat.geometry import Object
from meshcat.path import Path
from PIL.ImageColor import getrgb

from anm_mj.events import Ended, Observed, Stepped
from anm_mj.frames import pose_matrix
from anm_mj.io.run_events import Completed, Mapped, Started, headline
from anm_mj.localisation.localiser import TrackingState
from anm_mj.protocols import Mapper
from anm_mj.types import DEFAULT_FOOTPRINT, Observation, Plan, StopReason
from anm_mj.utils.picture import jpeg_url
from anm_mj.viz import palette, shapes
from anm_mj.viz.assets import filled, page_asset, script_json
from anm_mj.viz.page_server import FIRST_PORT, PageServer

logger = logging.getLogger(__name__)

MESH_TIME_FRACTION = 0.05
"""Largest fraction of the run's time for making meshes of the view."""
MESH_EVERY_STEPS = 20
FIRST_MESH_STEP = 10
"""Before it the map has learnt too little: its surface is in shreds."""
MESH_RESOLUTION_M = 0.1
TRAJECTORY_SEGMENT_STEPS = 50
"""Steps per segment of the trajectory; the cost of a step stays constant, because only the last segment changes."""
LEGEND = (("mesh", *palette.LEGEND[0][1:]), *palette.LEGEND[1:])
"""Here the surface is an object of meshcat named mesh."""
BODY, FRUSTUM, _, GRAPH, REGIONS, PATH, TARGET = (palette.number(colour) for _, _, colour in LEGEND[1:])
TRAJECTORY = palette.number(palette.TRAJECTORY)
PICTURE_PX, PICTURE_QUALITY = 160, 75
UNSEEN_S = 5.0
"""A paused run goes on when no page has been open for so long [s]."""


@runtime_checkable
class Meshable(Protocol):
    """A map with a surface mesh."""

    def mesh(self, resolution_m: float, *, reuse: bool) -> trimesh.Trimesh:
        """The surface as a coloured mesh, world [m]; with ``reuse``, recomputed only where the map has changed."""
        ...


class LiveView:
    """Shows a run on a local web page; the run does not depend on it.

    The mesh is updated only while a browser is connected, at most every 20 steps, and takes at most 5 % of the run's
    time. It takes ``port``, by default 7000, or the next free one; ``is_ending`` tells whether somebody else has asked
    for the end of the run, which then waits for no page. Raises RenderError if no port is free.
    """

    def __init__(
        self, port: int | None = None, title: str = "anm-mj", is_ending: Callable[[], bool] = lambda: False
    ) -> None:
        parts = {
            "TITLE": "anm-mj",
            "STYLE": page_asset("style.css"),
            "DATA": script_json(LEGEND),
            "PROGRAM": page_asset("theme.js", "curve.js", "live.js"),
        }
        self._server = PageServer(FIRST_PORT if port is None else port, filled("live.html", parts), self._on_word)
        self._is_ending = is_ending
        self._stopped, self._running = threading.Event(), threading.Event()
        self._running.set()
        self._server.say("title", {"title": title})
        self._failed = False
        self._unit = "steps"
        self._started: Started | None = None
        self._radius_m = DEFAULT_FOOTPRINT.radius_m
        self._is_lost = False
        """Whether nobody knows where the camera of the last observation was."""
        self._trajectory_xy_m: list[Float[np.ndarray, "2"]] = []
        """One place per observation shown, NaN where the robot was lost: the trajectory has a gap there."""
        self._curve: list[tuple[int, float]] = []
        self._plan: Plan | None = None
        self._begin_s = time.perf_counter()
        self._mesh_s = 0.0
        self._mesh_step: int | None = None
        self._whole_mesh_step = 0
        logger.info("Watch the run at %s", self._server.url)
        there = _user() + socket.gethostname()
        port = self._server.port
        logger.info("On another machine, run first: ssh -L %d:127.0.0.1:%d %s", port, port, there)

    @property
    def url(self) -> str:
        """Address of the page."""
        return self._server.url

    def on_event(self, event: object) -> bool:
        """Show an event of the run; see :class:`anm_mj.events.Observer`.

        It returns quickly, but after a step while the page has paused the run. True where the page has stopped it.
        """
        if isinstance(event, Started):
            self._started = event
            if event.footprint is not None:
                self._radius_m = event.footprint.radius_m
        elif isinstance(event, Observed):
            # Comes before what tells to show the same observation.
            self._is_lost = event.estimate is not None and event.estimate.state is TrackingState.LOST
        elif isinstance(event, Stepped | Mapped):
            self.show(event.observation, event.mapper, event.plan)
            if self._started is not None:
                is_step = isinstance(event, Stepped)
                self._unit = "steps" if is_step else "frames"
                step, row = (event.step, self._started.completed()) if is_step else (event.observation.step + 1, None)
                self.progress(step, self._started.num_steps, row)
            self._wait_while_paused()
        elif isinstance(event, Ended):
            folder = "runs/latest" if self._started is None else shlex.quote(str(self._started.folder))
            self._server.say("ended", {"ended": f"{_end(event, self._unit)} Replay it: anm-mj view {folder}"})
        return self._stopped.is_set()

    def _on_word(self, word: str) -> None:
        """Do what a page asks for; called in the server's thread."""
        if word == "stop":
            self._stopped.set()
        if word in ("pause", "go on", "stop"):
            (self._running.clear if word == "pause" else self._running.set)()
            self._server.say("state", {"paused": word == "pause", "stopping": self._stopped.is_set()})

    def _wait_while_paused(self) -> None:
        seen_s = time.monotonic()
        while not self._running.wait(0.1) and not self._is_ending():
            if self._server.num_browsers:
                seen_s = time.monotonic()
            elif time.monotonic() - seen_s > UNSEEN_S:
                self._on_word("go on")

    def show(self, observation: Observation, mapper: Mapper, plan: Plan | None) -> None:
        """Show the present state; returns quickly, and an error disables the view but not the run."""
        if self._failed:
            return
        try:
            if not self._trajectory_xy_m:
                self._set_up_page(observation)
            self._show_robot(observation)
            if plan is not None and plan is not self._plan:
                self._show_plan(plan)
                self._server.say("reason", {"reason": plan.reason})
            if self._server.num_browsers:
                self._server.say(
                    "picture", {"picture": jpeg_url(_with_moved(observation), PICTURE_PX, PICTURE_QUALITY)}
                )
            if isinstance(mapper, Meshable) and self._mesh_is_due(observation.step):
                self._show_mesh(mapper, observation.step)
        except Exception:
            # No error of the view may stop the run.
            logger.exception("An error disabled the live view; the run continues.")
            self._failed = True

    def progress(self, step: int, num_steps: int, row: Completed | None) -> None:
        """Tell the page how far the run is; ``row``: the newest of the completion curve, None = not measured."""
        completed = "" if row is None else "{:.1f} % of {}".format(*headline(row))
        self._server.say("progress", {"step": step, "num_steps": num_steps, "completed": completed})
        if row is not None and (not self._curve or row.step != self._curve[-1][0]):
            self._curve.append((row.step, headline(row)[0]))
            self._server.say("curve", {"curve": self._curve, "num_steps": num_steps})

    def close(self) -> None:
        """Show the last figure, and free the port; a second time does nothing."""
        if self._started is not None and (row := self._started.completed()) is not None:
            self.progress(row.step, self._started.num_steps, row)
        self._server.close()

    def _set_up_page(self, observation: Observation) -> None:
        pose, camera = observation.pose, observation.T_world_camera
        self._centre(pose.xy_m)
        # In camera axes y is up: a steep view from the south.
        self._property("/Cameras/default/rotated/<object>", "position", [0.0, 9.0, 5.0])
        self._object("robot", shapes.robot_body(self._radius_m, float(camera[2, 3]), BODY))
        self._object("camera", shapes.camera_frustum(observation.intrinsics, FRUSTUM))
        self._object("target/pin", shapes.target_mark(TARGET))
        self._property("/meshcat/target/pin", "visible", False)

    def _show_robot(self, observation: Observation) -> None:
        self._transform("/meshcat/robot", pose_matrix(observation.pose))
        self._transform("/meshcat/camera", observation.T_world_camera)
        for name in ("robot", "camera"):
            # The property of the group itself is that of its check box in the page.
            self._property(f"/meshcat/{name}/<object>", "visible", not self._is_lost)
        self._trajectory_xy_m.append(np.full(2, np.nan) if self._is_lost else observation.pose.xy_m)
        segment = (len(self._trajectory_xy_m) - 1) // TRAJECTORY_SEGMENT_STEPS
        xy_m = np.array(self._trajectory_xy_m[max(0, segment * TRAJECTORY_SEGMENT_STEPS - 1) :])
        ends_m = np.stack([xy_m[:-1], xy_m[1:]], axis=1)
        known = np.isfinite(ends_m).all(axis=(1, 2))
        band = shapes.bands(ends_m[known], shapes.TRAJECTORY_HEIGHT_M, shapes.TRAJECTORY_WIDTH_M, TRAJECTORY)
        self._object(f"trajectory/{segment}", band)

    def _show_plan(self, plan: Plan) -> None:
        self._plan = plan
        if plan.graph is not None:
            self._object("graph", shapes.graph_bands(plan.graph, GRAPH))
            self._object("regions", shapes.region_marks(plan.regions, REGIONS))
        self._object("path", shapes.ribbon(plan.path_xy_m, shapes.PATH_HEIGHT_M, shapes.PATH_WIDTH_M, PATH))
        target = plan.target_xy_m
        # The property of the target itself is that of its check box in the page.
        self._property("/meshcat/target/pin", "visible", target is not None)
        if target is not None:
            self._transform("/meshcat/target", trimesh.transformations.translation_matrix([*target, 0.0]))

    def _mesh_is_due(self, step: int) -> bool:
        if self._server.num_browsers == 0 or step < FIRST_MESH_STEP:
            return False
        if self._mesh_step is None:
            return True
        affordable = self._mesh_s <= MESH_TIME_FRACTION * (time.perf_counter() - self._begin_s)
        return affordable and step - self._mesh_step >= MESH_EVERY_STEPS

    def _show_mesh(self, mapper: Meshable, step: int) -> None:
        begin_s = time.perf_counter()
        self._mesh_step = step
        # What is kept stays as the map saw it then, and the parts rip where they meet. Made as a whole whenever the run
        # has doubled, the mesh costs little more, and forgets what the young map believed.
        whole = step >= 2 * self._whole_mesh_step
        if whole:
            self._whole_mesh_step = step
        mesh = mapper.mesh(MESH_RESOLUTION_M, reuse=not whole)
        if len(mesh.faces):
            self._object("mesh", shapes.neural_surface(mesh))
            self._centre(np.asarray(mesh.bounds).mean(axis=0)[:2])
        self._mesh_s += time.perf_counter() - begin_s

    def _centre(self, xy_m: Float[np.ndarray, "2"]) -> None:
        # The page's camera only orbits the origin, so the world moves instead.
        self._transform("/meshcat", trimesh.transformations.translation_matrix([-xy_m[0], -xy_m[1], 0.0]))

    def _object(self, name: str, thing: Object) -> None:
        self._server.publish(SetObject(thing, path=Path().append(f"/meshcat/{name}")))

    def _transform(self, path: str, T: Float[np.ndarray, "4 4"]) -> None:
        self._server.publish(SetTransform(T, Path().append(path)))

    def _property(self, path: str, key: str, value: object) -> None:
        self._server.publish(SetProperty(key, value, Path().append(path)))


def _user() -> str:
    """The user's name with @, for ssh; empty for one whom the system does not know, as in containers."""
    try:
        return f"{getpass.getuser()}@"
    except (KeyError, OSError):
        return ""


def _end(event: Ended, unit: str) -> str:
    """How a run of steps or frames ended; a budget that is used up is the usual end."""
    word = {StopReason.BUDGET: "Done", StopReason.COMPLETE: "Complete"}.get(event.stop_reason)
    after = f"after {event.num_steps} {unit}"
    return f"{word} {after}." if word else f"Ended {after}: {event.stop_reason}."


def _with_moved(observation: Observation) -> UInt8[np.ndarray, "h w 3"]:
    """The colour image, with moved pixels tinted."""
    if observation.moved_m is None:
        return observation.rgb
    tinted = observation.rgb // 2 + np.array(getrgb(palette.PERSON), np.uint8) // 2
    return np.where(np.isfinite(observation.moved_m)[..., None], tinted, observation.rgb)
