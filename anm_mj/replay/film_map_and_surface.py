"""The lower pictures of a film's frame: the map and its surface."""

import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image, ImageDraw
from PIL.ImageColor import getrgb

from anm_mj.io.plan_file import PlanRecord
from anm_mj.replay.film_depth_and_colour import PANEL_PX, font
from anm_mj.replay.oblique_view import ObliqueView, project
from anm_mj.replay.surface import GrowingMesh
from anm_mj.types import TopDownMap
from anm_mj.viz import palette

SUPERSAMPLING = 2
"""Lines are drawn at this multiple of the panel's size, and averaged."""
MARGIN_M = 0.4


class MapPanel:
    """The top-down map with graph, path and trajectory. ``low_m`` and ``high_m`` are the south-west and the north-east
    corner that is shown; ``radius_m`` is that of the robot.
    """

    def __init__(self, low_m: Float[np.ndarray, "2"], high_m: Float[np.ndarray, "2"], radius_m: float) -> None:
        self._side_px = PANEL_PX * SUPERSAMPLING
        self._metres_per_px = float(max(high_m - low_m)) / self._side_px
        self._low_m = (low_m + high_m) / 2.0 - self._side_px * self._metres_per_px / 2.0
        self._radius_m = radius_m
        self._base = Image.new("RGB", (self._side_px, self._side_px), palette.UNKNOWN)

    def decide(self, plan: PlanRecord) -> None:
        """Draw what changes with a decision only: map, graph, regions."""
        if plan.topdown is not None:
            self._base = Image.fromarray(self._map(plan.topdown))
        if plan.graph is None:
            return
        draw = ImageDraw.Draw(self._base)
        ends = self._px(plan.graph.vertex_xy_m[plan.graph.edges].reshape(-1, 2)).reshape(-1, 4)
        for x0, y0, x1, y1 in ends.tolist():
            draw.line([(x0, y0), (x1, y1)], palette.GRAPH, 3)
        for x, y in self._px(np.array([region.centre_m[:2] for region in plan.regions]).reshape(-1, 2)).tolist():
            draw.ellipse([x - 8, y - 8, x + 8, y + 8], palette.REGION)

    def draw(
        self,
        trajectory_xy_m: Float[np.ndarray, "n 2"],
        yaw_rad: float,
        path_xy_m: Float[np.ndarray, "k 2"],
        target_xy_m: Float[np.ndarray, "2"] | None,
        true_xy_m: Float[np.ndarray, "n 2"] | None = None,
        is_lost: Bool[np.ndarray, " n"] | None = None,
        ellipse_m: Float[np.ndarray, "3"] | None = None,
        discs_m: Float[np.ndarray, "p 4"] | None = None,
        leaves_m: Float[np.ndarray, "d 2 2"] | None = None,
    ) -> Image.Image:
        """The panel at a frame.

        Args:
            trajectory_xy_m: Where the robot believed to be up to now, world [m].
            yaw_rad: Its heading.
            path_xy_m: The planned path, world [m].
            target_xy_m: Where that ends.
            true_xy_m: Where it truly was; None where it believed that.
            is_lost: At which frames it did not know where it was; None = at none.
            ellipse_m: Half axes of its uncertainty [m] and the direction of the longer one [rad].
            discs_m: What moved, as :func:`anm_mj.replay.movers.discs` has it; None = nobody is drawn.
            leaves_m: Both ends of the leaves of doors, world [m]; None = there are none.
        """
        image = self._base.copy()
        draw = ImageDraw.Draw(image)
        lines = [(each, palette.TRAJECTORY, 6) for each in known_pieces(trajectory_xy_m, is_lost)]
        if true_xy_m is not None:
            lines.insert(0, (true_xy_m, palette.TRUE, 2))
            lines.append((true_xy_m, palette.TRUE, 2))
        for line, colour, width in (*lines, (path_xy_m, palette.PATH, 5)):
            if len(line) > 1:
                draw.line([tuple(point) for point in self._px(line).tolist()], colour, width, "curve")
        if target_xy_m is not None:
            ((x, y),) = self._px(target_xy_m[None]).tolist()
            draw.ellipse([x - 11, y - 11, x + 11, y + 11], palette.TARGET, "white", 3)
        for leaf in leaves_m if leaves_m is not None else ():
            draw.line([tuple(point) for point in self._px(leaf).tolist()], palette.PERSON, 8)
        if discs_m is not None:
            radius = np.maximum(discs_m[:, 2] / self._metres_per_px, 8.0)
            for (x, y), r in zip(self._px(discs_m[:, :2]).tolist(), radius.tolist(), strict=True):
                draw.ellipse([x - r, y - r, x + r, y + r], palette.PERSON, "white", 3)
        if is_lost is None or not is_lost[-1]:
            self._draw_robot(draw, trajectory_xy_m[-1], yaw_rad)
            if ellipse_m is not None:
                turn = np.linspace(0.0, 2.0 * np.pi, 49)
                c, s = np.cos(ellipse_m[2]), np.sin(ellipse_m[2])
                ring = np.stack([ellipse_m[0] * np.cos(turn), ellipse_m[1] * np.sin(turn)], axis=1)
                ring = trajectory_xy_m[-1] + ring @ np.array([[c, s], [-s, c]])
                draw.line([tuple(point) for point in self._px(ring).tolist()], palette.PATH, 3, "curve")
        if true_xy_m is not None:
            ((x, y),) = self._px(true_xy_m[-1:]).tolist()
            draw.ellipse([x - 6, y - 6, x + 6, y + 6], None, palette.TRUE, 3)
        return _with_scale(image.reduce(SUPERSAMPLING), self._metres_per_px * SUPERSAMPLING)

    def _draw_robot(self, draw: ImageDraw.ImageDraw, xy_m: Float[np.ndarray, "2"], yaw_rad: float) -> None:
        ((x, y),) = self._px(xy_m[None]).tolist()
        radius = max(self._radius_m / self._metres_per_px, 12.0)
        angle = -np.degrees(yaw_rad)
        draw.pieslice(
            [x - 3 * radius, y - 3 * radius, x + 3 * radius, y + 3 * radius], angle - 45, angle + 45, "#bcd2e6"
        )
        draw.ellipse([x - radius, y - radius, x + radius, y + radius], palette.CAMERA, "white", 3)

    def _map(self, topdown: TopDownMap) -> UInt8[np.ndarray, "side side 3"]:
        at = self._low_m[:, None] + (np.arange(self._side_px) + 0.5) * self._metres_per_px
        col, row = np.floor((at - topdown.origin_xy_m[:, None]) / topdown.resolution_m).astype(np.int64)
        rows, cols = topdown.state.shape
        inside = ((row >= 0) & (row < rows))[:, None] & ((col >= 0) & (col < cols))
        pick = np.ix_(np.clip(row, 0, rows - 1), np.clip(col, 0, cols - 1))
        image = np.where(inside[..., None], palette.tint(topdown)[pick], np.array(getrgb(palette.UNKNOWN), np.uint8))
        return np.ascontiguousarray(image[::-1])

    def _px(self, xy_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        x, y = ((xy_m - self._low_m) / self._metres_per_px).T
        return np.stack([x, self._side_px - y], axis=1)


def known_pieces(
    xy_m: Float[np.ndarray, "n 2"], is_lost: Bool[np.ndarray, " n"] | None
) -> list[Float[np.ndarray, "k 2"]]:
    """A trajectory without the frames at which the robot was lost: the pieces between them."""
    if is_lost is None or not is_lost.any():
        return [xy_m]
    known = np.flatnonzero(~is_lost)
    return [xy_m[each] for each in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1) if len(each)]


class SurfacePanel:
    """The growing mesh with the robot and its trajectory."""

    def __init__(self, mesh: GrowingMesh) -> None:
        flat = project(mesh.vertices_m)
        low, high = flat.min(axis=0) - MARGIN_M, flat.max(axis=0) + MARGIN_M
        side_px = PANEL_PX * SUPERSAMPLING
        self._metres_per_px = float(max(high - low)) / side_px
        self._low_m = (low + high) / 2.0 - side_px * self._metres_per_px / 2.0
        self._view = ObliqueView(mesh, self._low_m, self._metres_per_px, (side_px, side_px), getrgb("#f3f4f6"))

    def draw(
        self, frame: int, trajectory_xy_m: Float[np.ndarray, "n 2"], is_lost: Bool[np.ndarray, " n"] | None = None
    ) -> Image.Image:
        """The panel at a frame; to be asked for in order."""
        image = Image.fromarray(self._view.at(frame))
        draw = ImageDraw.Draw(image)
        line: list[tuple[float, float]] = []
        for piece in known_pieces(trajectory_xy_m, is_lost):
            floor = np.concatenate([piece, np.zeros((len(piece), 1))], axis=1)
            x, y = ((project(floor) - self._low_m) / self._metres_per_px).T
            line = list(zip(x.tolist(), (image.height - y).tolist(), strict=True))
            if len(line) > 1:
                draw.line(line, palette.TRAJECTORY, 5, "curve")
        if line and (is_lost is None or not is_lost[-1]):
            (x, y), r = line[-1], 13
            draw.ellipse([x - r, y - r, x + r, y + r], palette.CAMERA, "white", 3)
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
