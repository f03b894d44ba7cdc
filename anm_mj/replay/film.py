"""A film of a finished run: colour with the target, depth, map with graph and path, growing surface."""

import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw

from anm_mj.errors import AnmError
from anm_mj.io.write import writing
from anm_mj.replay.film_depth_and_colour import PANEL_PX, colour_panel, depth_panel, empty_panel, font
from anm_mj.replay.film_file import write_gif, write_mp4
from anm_mj.replay.film_map_and_surface import MapPanel, SurfacePanel
from anm_mj.replay.pictures import pictures
from anm_mj.replay.surface import GrowingMesh, growing_mesh
from anm_mj.replay.timeline import Timeline, is_any
from anm_mj.types import UNKNOWN, Plan
from anm_mj.utils.files import atomic_write
from anm_mj.utils.progress import Progress, unheard
from anm_mj.viz import palette

GAP_PX, HEAD_PX, FOOT_PX = 8, 60, 34
WIDTH_PX = 2 * PANEL_PX + 3 * GAP_PX
HEIGHT_PX = HEAD_PX + 2 * PANEL_PX + GAP_PX + FOOT_PX
MAX_FACES = 400_000
COVERAGE_OF = {"observable": "of the observable surface", "completion": "of the surface"}
MAX_FPS = {".mp4": 120.0, ".gif": 50.0}
"""By the file's ending; browsers show a GIF of more slower than it says."""
LEGEND = (
    ("free", palette.NEAR),
    ("occupied", palette.WALL),
    ("unknown", palette.UNKNOWN),
    ("Voronoi graph", palette.GRAPH),
    ("region of interest", palette.REGION),
    ("trajectory", palette.TRAJECTORY),
    ("path", palette.PATH),
    ("target", palette.TARGET),
    ("robot", palette.CAMERA),
)
TRUTH, PEOPLE = ("true", palette.TRUE), ("person", palette.PERSON)


class FilmError(AnmError):
    """A film cannot be written."""


def write_film(
    timeline: Timeline,
    path: Path,
    *,
    fps: float = 15.0,
    every: int = 1,
    scene: str | None = None,
    on_progress: Progress = unheard,
) -> None:
    """Write a film as MP4 (H.264) or GIF, by the file's ending. Only ``every`` so-manieth frame of the run is shown,
    ``fps`` of them per second. ``scene`` is the present name or folder of its scene, if it has moved; needed where no
    images were kept. Progress counts frames.

    Raises:
        FilmError: The file's ending is another, or a number is out of range.
        RunFolderError: A file of the run is damaged, or the film cannot be written.
    """
    if path.suffix not in MAX_FPS:
        raise FilmError(f"{path} ends in '{path.suffix}'; a film is an .mp4 or a .gif file.")
    most = MAX_FPS[path.suffix]
    if not 0.1 <= fps <= most:
        raise FilmError(f"The film would have {fps:g} frames per second; choose 0.1 to {most:g} for {path.suffix}.")
    if every < 1:
        raise FilmError(f"Every {every}th frame cannot be shown; give a whole number from 1 up.")
    images = film_frames(timeline, every=every, scene=scene, on_progress=on_progress)
    write = write_gif if path.suffix == ".gif" else write_mp4
    with writing(path), atomic_write(path) as partial:
        # What the system says of a place that cannot be written to is clearer than what ffmpeg says.
        partial.touch()
        write(partial, images, WIDTH_PX, HEIGHT_PX, fps)


def film_frames(
    timeline: Timeline, *, every: int = 1, scene: str | None = None, on_progress: Progress = unheard
) -> Iterator[UInt8[np.ndarray, "h w 3"]]:
    """The pictures of a film; arguments and errors as of :func:`write_film`."""
    run, total = timeline.run, timeline.num_frames
    mesh = growing_mesh(run, MAX_FACES, with_errors=False)
    surface = None if mesh is None or not len(mesh.faces) else SurfacePanel(mesh)
    map_panel = MapPanel(_known_xy_m(timeline, mesh), timeline.radius_m)
    far_m = _far_m(timeline)
    truth = (TRUTH,) if timeline.true_xy_m is not None else ()
    background = _background((*LEGEND, *truth, *((PEOPLE,) if is_any(run.frames[0]) else ())))
    shown, plan, reason = -1, Plan(""), ""
    for index, (frame, rgb) in enumerate(zip(run.frames, pictures(run, scene), strict=True)):
        on_progress(index + 1, total)
        if index % every and index != total - 1:
            continue
        decided = int(timeline.plan_of_frame[index])
        if decided != shown:
            shown, plan, reason = decided, timeline.plan(decided), run.plans[decided].get("reason", "")
            map_panel.decide(plan)
        target = plan.path_xy_m[-1] if len(plan.path_xy_m) else None
        panels = (
            colour_panel(rgb, frame, run.intrinsics, target),
            depth_panel(run.depth_mm(frame), far_m, run.intrinsics),
            map_panel.draw(timeline, index, plan.path_xy_m),
            surface.draw(timeline, index) if surface else empty_panel("no mesh: the run did not end", "#f3f4f6"),
        )
        yield np.asarray(_composed(background, panels, timeline.title, _status(timeline, index), reason))


def _composed(
    background: Image.Image, panels: tuple[Image.Image, ...], title: str, status: str, reason: str
) -> Image.Image:
    image = background.copy()
    draw = ImageDraw.Draw(image)
    draw.text((GAP_PX + 2, 18), title, "#23262b", font(17), anchor="lm")
    draw.text((WIDTH_PX - GAP_PX - 2, 18), status, "#23262b", font(17), anchor="rm")
    draw.text((GAP_PX + 2, 43), _cut(reason, draw), "#5d6570", font(15), anchor="lm")
    for k, (panel, name) in enumerate(zip(panels, ("colour", "depth", "map", "surface of the map"), strict=True)):
        corner = (GAP_PX + k % 2 * (PANEL_PX + GAP_PX), HEAD_PX + k // 2 * (PANEL_PX + GAP_PX))
        image.paste(panel, corner)
        x, y = corner[0] + 8, corner[1] + 8
        right = x + 14 + draw.textlength(name, font(14))
        draw.rounded_rectangle([x, y, right, y + 22], 4, "white")
        draw.text((x + 7, y + 11), name, "#23262b", font(14), anchor="lm")
    return image


def _background(legend: Sequence[tuple[str, str]]) -> Image.Image:
    """What is the same in every frame of a film: the legend."""
    image = Image.new("RGB", (WIDTH_PX, HEIGHT_PX), "white")
    draw = ImageDraw.Draw(image)
    x, y = float(GAP_PX + 2), HEIGHT_PX - FOOT_PX // 2
    for name, colour in legend:
        draw.rectangle([x, y - 6, x + 12, y + 6], colour, "#8a8a8a")
        draw.text((x + 18, y), name, "#23262b", font(14), anchor="lm")
        x += 18 + draw.textlength(name, font(14)) + 14
    return image


def _status(timeline: Timeline, index: int) -> str:
    (name, values), steps = timeline.coverage, timeline.steps
    covered = "" if math.isnan(values[index]) else f"   {values[index]:.1f} % {COVERAGE_OF[name]}"
    return f"{_pose_words(timeline, index)}step {steps[index]} of {steps[-1]}{covered}"


def _pose_words(timeline: Timeline, index: int) -> str:
    """How far the believed place is from the true one."""
    if timeline.is_lost[index]:
        return "LOST   "
    if timeline.true_xy_m is None:
        return ""
    return f"error {100.0 * math.dist(timeline.xy_m[index], timeline.true_xy_m[index]):.1f} cm   "


def _cut(text: str, draw: ImageDraw.ImageDraw) -> str:
    """A text that fits into a line."""
    room_px = WIDTH_PX - 2 * GAP_PX
    # No text of so many characters fits, and the rest of a long one is not worth measuring.
    shown = text[:room_px]
    if len(text) == len(shown) and draw.textlength(text, font(15)) <= room_px:
        return text
    fitting = bisect_right(range(1, len(shown) + 1), room_px, key=lambda n: draw.textlength(shown[:n] + " …", font(15)))
    return shown[:fitting] + " …"


def _known_xy_m(timeline: Timeline, mesh: GrowingMesh | None) -> Float[np.ndarray, "n 2"]:
    """What the map panel shows: all that is known at the end, world [m]."""
    points = [timeline.xy_m[~timeline.is_lost], *([] if timeline.true_xy_m is None else [timeline.true_xy_m])]
    if mesh is not None:
        points.append(mesh.vertices_m[:, :2].astype(np.float64))
    known = (timeline.plan(k).topdown for k in reversed(range(len(timeline.run.plans))))
    last = next((topdown for topdown in known if topdown is not None), None)
    if last is not None:
        row, col = np.nonzero(last.state != UNKNOWN)
        points.append(last.origin_xy_m + last.resolution_m * np.stack([col, row], axis=1))
    return np.concatenate(points)


def _far_m(timeline: Timeline) -> float:
    """Depth at the end of the scale: what 98 % of the pixels are nearer than, in whole metres."""
    some = [timeline.run.depth_mm(frame) for frame in timeline.run.frames[:: max(1, timeline.num_frames // 20)]]
    depths = np.concatenate([depth[depth > 0] for depth in some])
    return float(max(1, math.ceil(np.percentile(depths, 98.0) / 1000.0))) if len(depths) else 10.0
