"""Publishes what a run on a live robot knows and decides: map, graph, target, path, surface, pose, state."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from anm_mj.events import Decided, Ended, Observed, Stepped
from anm_mj.frames import pose_matrix
from anm_mj.localisation.localiser import PoseEstimate
from anm_mj.localisation.se3 import carried
from anm_mj.protocols import Mapper
from anm_mj.ros.connect import Connection
from anm_mj.ros.names import MAP, TF, TF_TYPE
from anm_mj.ros.node import LATCHED, STATE
from anm_mj.types import Observation, Plan, Pose2

TELL_S = 0.05
"""Between two statements of where the odometry is in the map [s]."""
SURFACE_EVERY, SURFACE_RADIUS_M, SURFACE_POINTS = 20, 4.0, 20_000
"""The surface within a radius [m] is published after so many steps, with so many points at most."""
_GREY, _BLUE, _RED, _GREEN = (0.5, 0.5, 0.5, 0.8), (0.1, 0.35, 0.9, 0.9), (0.85, 0.15, 0.1, 0.9), (0.1, 0.7, 0.2, 1.0)
_LINES, _BALLS = 5, 7
"""Numbers of ``LINE_LIST`` and ``SPHERE_LIST`` in ``visualization_msgs/Marker``."""
_OK, _WARN = 0, 1


class MapPublisher:
    """An observer of the loop; all topics are latched but for ``pose``, ``diagnostics`` and ``tf``."""

    def __init__(self, connection: Connection) -> None:
        """Announce the topics."""
        self._node, self._poses, self._health = connection.node, connection.poses, connection.health
        kinds = {
            "map": ("nav_msgs/msg/OccupancyGrid", LATCHED),
            "plan": ("nav_msgs/msg/Path", LATCHED),
            "explore/markers": ("visualization_msgs/msg/MarkerArray", LATCHED),
            "explore/surface": ("sensor_msgs/msg/PointCloud2", LATCHED),
            "pose": ("geometry_msgs/msg/PoseWithCovarianceStamped", STATE),
            "/diagnostics": ("diagnostic_msgs/msg/DiagnosticArray", STATE),
            TF: (TF_TYPE, STATE),
        }
        self._to = {topic: self._node.publisher(topic, kind, delivery) for topic, (kind, delivery) in kinds.items()}
        self._T_map_odom = np.eye(4)
        self._step, self._state, self._told_s, self._said_s = 0, "waits", 0.0, 0.0
        self._now_s = 0.0
        self.command: Callable[[], str] = lambda: ""
        """The last command to the run, for diagnostics."""

    def on_event(self, event: object) -> None:
        """See :class:`anm_mj.events.Observer`."""
        if isinstance(event, Observed):
            self._observed(event.observation, event.estimate)
        elif isinstance(event, Decided):
            self._decided(event.plan)
        elif isinstance(event, Stepped):
            self._step = event.step
            if event.step % SURFACE_EVERY == 0:
                self._surface(event.mapper, event.observation.pose)
        elif isinstance(event, Ended):
            self._state = f"ended: {event.stop_reason}"
            self.tell(force=True)
            self.diagnose(force=True)

    def tell(self, *, force: bool = False) -> None:
        """Publish ``map`` to odometry in the tree of frames; called with each pose."""
        now_s, told_s = self._poses.latest_s, time.monotonic()
        if not np.isfinite(now_s) or (told_s - self._told_s < TELL_S and not force):
            return
        self._told_s = told_s
        links = [(MAP, self._poses.odometry_frame, self._T_map_odom)]
        if self._poses.odometry_frame != MAP:
            self._to[TF].publish(self._node.messages.transforms(now_s, links))

    def _observed(self, seen: Observation, estimate: PoseEstimate | None) -> None:
        self._now_s = seen.time_s
        T_odom_base = self._poses.in_odometry_frame(seen.time_s)
        if T_odom_base is not None:
            self._T_map_odom = pose_matrix(seen.pose) @ np.linalg.inv(T_odom_base)
        make = self._node.messages
        covariance = np.zeros(36)
        if estimate is not None:
            T_world_camera = estimate.observation.T_world_camera
            covariance = carried(T_world_camera, estimate.covariance, pose_matrix(seen.pose)).ravel()
        pose = make.make("geometry_msgs/msg/PoseWithCovariance", pose=make.base_pose(seen.pose), covariance=covariance)
        self._publish("pose", "geometry_msgs/msg/PoseWithCovarianceStamped", pose=pose)
        self.tell()

    def _decided(self, plan: Plan) -> None:
        self._state = plan.reason
        make, now_s = self._node.messages, self._now_s
        self._to["plan"].publish(make.path(now_s, MAP, plan.path_xy_m))
        if plan.topdown is not None:
            self._to["map"].publish(make.occupancy(now_s, MAP, plan.topdown))
        ends, target = np.zeros((0, 2)), plan.target_xy_m
        if plan.graph is not None:
            ends = plan.graph.vertex_xy_m[plan.graph.edges.ravel()]
        regions = np.array([region.centre_m for region in plan.regions]).reshape(-1, 3)
        places = np.array([candidate.xy_m for candidate in plan.candidates]).reshape(-1, 2)
        markers = [
            self._marker("graph", _LINES, ends, 0.02, _GREY),
            self._marker("regions", _BALLS, regions, 0.15, _RED),
            self._marker("candidates", _BALLS, places, 0.1, _BLUE),
            self._marker("target", _BALLS, np.zeros((0, 2)) if target is None else target[None], 0.25, _GREEN),
        ]
        array = make.make("visualization_msgs/msg/MarkerArray", markers=markers)
        self._to["explore/markers"].publish(array)

    def _surface(self, mapper: Mapper, pose: Pose2) -> None:
        surface = mapper.surface(pose.xy_m, SURFACE_RADIUS_M)
        every = -(-len(surface.xyz_m) // SURFACE_POINTS) or 1
        points, doubt = surface.xyz_m[::every].astype(float), surface.uncertainty[::every]
        # Red is what the map knows worst.
        share = np.clip(doubt / max(2.0 * float(np.median(doubt)), 1e-12), 0.0, 1.0) if len(doubt) else doubt
        colours = np.stack([255 * share, 255 * (1.0 - share), np.full(len(share), 60.0)], axis=1).astype(np.uint8)
        self._to["explore/surface"].publish(self._node.messages.cloud(self._now_s, MAP, points, colours))

    def diagnose(self, *, force: bool = False) -> None:
        """Publish the state each second, whatever else is silent; called more often than that."""
        now_s, said_s = self._poses.latest_s, time.monotonic()
        if said_s - self._said_s < 1.0 and not force:
            return
        # Before the first pose nobody knows the robot's clock.
        now_s, self._said_s = now_s if np.isfinite(now_s) else time.time(), said_s
        make, fault = self._node.messages, self._health.present()
        values = [
            make.make("diagnostic_msgs/msg/KeyValue", key=key, value=value)
            for key, value in (("step", str(self._step)), ("plan", self._state), ("command", self.command()))
        ]
        status = make.make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=_OK if fault is None else _WARN,
            name="anm_mj: explore",
            message=fault or "explores",
            hardware_id="",
            values=values,
        )
        self._publish("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", at_s=now_s, status=[status])

    def _publish(self, topic: str, kind: str, *, at_s: float | None = None, **fields: Any) -> None:
        make = self._node.messages
        header = make.header(self._now_s if at_s is None else at_s, MAP)
        self._to[topic].publish(make.make(kind, header=header, **fields))

    def _marker(
        self, name: str, kind: int, places_m: Float[np.ndarray, "n d"], size_m: float, colour: tuple[float, ...]
    ) -> Any:
        """Lines or balls; without any place, it takes those away that were there."""
        make = self._node.messages
        heights = places_m if places_m.shape[1] == 3 else np.pad(places_m, ((0, 0), (0, 1)), constant_values=0.05)
        return make.make(
            "visualization_msgs/msg/Marker",
            header=make.header(self._now_s, MAP),
            ns=name,
            id=0,
            type=kind,
            action=0 if len(places_m) else 2,
            pose=make.pose((0.0, 0.0, 0.0)),
            scale=make.vector((size_m, size_m, size_m)),
            color=make.make("std_msgs/msg/ColorRGBA", **dict(zip("rgba", colour, strict=True))),
            lifetime=make.make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
            frame_locked=False,
            points=[make.point(place) for place in heights.tolist()],
            colors=[],
            texture_resource="",
            texture=make.make(
                "sensor_msgs/msg/CompressedImage", header=make.header(0.0, ""), format="", data=np.zeros(0, np.uint8)
            ),
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=make.make("visualization_msgs/msg/MeshFile", filename="", data=np.zeros(0, np.uint8)),
            mesh_use_embedded_materials=False,
        )
