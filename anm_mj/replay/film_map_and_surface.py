"""The lower pictures of a film's frame: the map and its surface."""

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw
from PIL.ImageColor import getrgb

from anm_mj.io.sequence_poses import base_pose
from anm_mj.replay.film_depth_and_colour import PANEL_PX, font
from anm_mj.replay.oblique_view import ObliqueView, square_around
from anm_mj.replay.surface import GrowingMesh
from anm_mj.replay.timeline import Timeline, discs, known_pieces, leaf_ends, leaves
from anm_mj.types import Plan, TopDownMap
from anm_mj.viz import palette

SUPERSAMPLING = 2
"""Lines are drawn at this multiple of the panel's size, and averaged."""
SIDE_PX = PANEL_PX * SUPERSAMPLING


class MapPanel:
    """The top-down map with graph, path and trajectory, as large as ``shown_m``, world; ``radius_m`` is that of the
    robot.
    """

    def __init__(self, shown_m: Float[np.ndarray, "n 2"], radius_m: float) -> None:
        self._low_m, self._metres_per_px = square_around(shown_m, SIDE_PX)
        self._radius_m = radius_m
        self._base = Image.new("RGB", (SIDE_PX, SIDE_PX), palette.UNKNOWN)

    def decide(self, plan: Plan) -> None:
        """Draw what changes with a decision only: map, graph, regions."""
        if plan.topdown is not None:
            self._base = Image.fromarray(self._map(plan.topdown))
        if plan.graph is None:
            return
        draw = ImageDraw.Draw(self._base)
        vertices = self._px(plan.graph.vertex_xy_m)
        for begin, end in plan.graph.edges:
            draw.line([vertices[begin], vertices[end]], palette.GRAPH, 3)
        for region in plan.regions:
            draw.circle(self._px(region.centre_m[None, :2])[0], 8, palette.REGION)

    def draw(self, timeline: Timeline, index: int, path_xy_m: Float[np.ndarray, "k 2"]) -> Image.Image:
        """The panel at a frame: where the robot believed to be up to then, where it was, its path, and what moves."""
        image = self._base.copy()
        draw = ImageDraw.Draw(image)
        frame, true_xy_m = timeline.run.frames[index], timeline.true_xy_m
        lines = [(each, palette.TRAJECTORY, 6) for each in known_pieces(timeline, index)]
        if true_xy_m is not None:
            true = (true_xy_m[: index + 1], palette.TRUE, 2)
            lines = [true, *lines, true]
        for line, colour, width in (*lines, (path_xy_m, palette.PATH, 5)):
            if len(line) > 1:
                draw.line(self._px(line), colour, width, "curve")
        if len(path_xy_m):
            draw.circle(self._px(path_xy_m[-1:])[0], 11, palette.TARGET, "white", 3)
        for leaf in leaf_ends(leaves(frame)):
            draw.line(self._px(leaf), palette.PERSON, 8)
        moved = discs(frame)
        for place, radius_m in zip(self._px(moved[:, :2]), moved[:, 2].tolist(), strict=True):
            draw.circle(place, max(radius_m / self._metres_per_px, 8.0), palette.PERSON, "white", 3)
        if not frame.is_lost:
            self._draw_robot(draw, timeline, index)
        if true_xy_m is not None:
            draw.circle(self._px(true_xy_m[index : index + 1])[0], 6, None, palette.TRUE, 3)
        return _with_scale(image.reduce(SUPERSAMPLING), self._metres_per_px * SUPERSAMPLING)

    def _draw_robot(self, draw: ImageDraw.ImageDraw, timeline: Timeline, index: int) -> None:
        """The robot with the cone that it looks into, and the uncertainty of its position."""
        frame, camera = timeline.run.frames[index], timeline.run.intrinsics
        pose = frame.pose
        ((x, y),) = self._px(pose.xy_m[None])
        radius = max(self._radius_m / self._metres_per_px, 12.0)
        # Angles of the picture are clockwise, as columns of an image are seen from above.
        ahead = -np.degrees(base_pose(frame.T_world_camera).yaw_rad)
        left, right = np.degrees(np.arctan([-camera.cx / camera.fx, (camera.width - camera.cx) / camera.fx]))
        draw.pieslice(
            [x - 3 * radius, y - 3 * radius, x + 3 * radius, y + 3 * radius], ahead + left, ahead + right, "#bcd2e6"
        )
        draw.circle((x, y), radius, palette.CAMERA, "white", 3)
        ellipse_m = timeline.ellipse_m(index)
        if ellipse_m is not None:
            turn = np.linspace(0.0, 2.0 * np.pi, 49)
            c, s = np.cos(ellipse_m[2]), np.sin(ellipse_m[2])
            ring = np.stack([ellipse_m[0] * np.cos(turn), ellipse_m[1] * np.sin(turn)], axis=1)
            ring = pose.xy_m + ring @ np.array([[c, s], [-s, c]])
            draw.line(self._px(ring), palette.PATH, 3, "curve")

    def _map(self, topdown: TopDownMap) -> UInt8[np.ndarray, "side side 3"]:
        at = self._low_m[:, None] + (np.arange(SIDE_PX) + 0.5) * self._metres_per_px
        col, row = np.floor((at - topdown.origin_xy_m[:, None]) / topdown.resolution_m).astype(np.int64)
        rows, cols = topdown.state.shape
        inside = ((row >= 0) & (row < rows))[:, None] & ((col >= 0) & (col < cols))
        pick = np.ix_(np.clip(row, 0, rows - 1), np.clip(col, 0, cols - 1))
        image = np.where(inside[..., None], palette.tint(topdown)[pick], np.array(getrgb(palette.UNKNOWN), np.uint8))
        return np.ascontiguousarray(image[::-1])

    def _px(self, xy_m: Float[np.ndarray, "n 2"]) -> list[tuple[float, float]]:
        """World points in the picture, from its upper left corner."""
        x, y = ((xy_m - self._low_m) / self._metres_per_px).T
        return list(zip(x.tolist(), (SIDE_PX - y).tolist(), strict=True))


class SurfacePanel:
    """The growing mesh with the robot and its trajectory."""

    def __init__(self, mesh: GrowingMesh) -> None:
        self._view = ObliqueView(mesh, SIDE_PX, getrgb("#f3f4f6"))

    def draw(self, timeline: Timeline, index: int) -> Image.Image:
        """The panel at a frame; to be asked for in order."""
        image = Image.fromarray(self._view.at(index))
        draw = ImageDraw.Draw(image)
        line: list[tuple[float, float]] = []
        for piece in known_pieces(timeline, index):
            x, y = self._view.place_px(np.pad(piece, ((0, 0), (0, 1)))).T
            line = list(zip(x.tolist(), (SIDE_PX - y).tolist(), strict=True))
            if len(line) > 1:
                draw.line(line, palette.TRAJECTORY, 5, "curve")
        if line and not timeline.is_lost[index]:
            draw.circle(line[-1], 13, palette.CAMERA, "white", 3)
        return image.reduce(SUPERSAMPLING)


def _with_scale(panel: Image.Image, metres_per_px: float) -> Image.Image:
    """A panel with a bar of a round length in its corner, at most a third of its width."""
    most_m = PANEL_PX * metres_per_px / 3.0
    length_m = max(step * 10.0**power for power in range(-2, 4) for step in (1, 2, 5) if step * 10.0**power <= most_m)
    right, low = 16 + length_m / metres_per_px, PANEL_PX - 14
    draw, words = ImageDraw.Draw(panel), f"{length_m:g} m"
    wide = max(right, 16 + draw.textlength(words, font(13)))
    draw.rounded_rectangle([8, PANEL_PX - 42, wide + 8, PANEL_PX - 6], 4, "white")
    draw.line([(16, low - 5), (16, low), (right, low), (right, low - 5)], palette.WALL, 2)
    draw.text(((16 + right) / 2, low - 6), words, palette.WALL, font(13), anchor="mb")
    return panel
