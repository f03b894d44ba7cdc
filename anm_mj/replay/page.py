"""The replay of a run as one HTML page that needs no server and no network.

The page holds meshcat's bundle of three.js, which the live view has anyway. Of the libraries at hand, viser and rerun
fetch their data from a server or a second file, which a browser refuses for a page opened from disk.
"""

import base64
import html
from collections.abc import Callable, Sequence
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Float, Float32, UInt8

from anm_mj.replay.pictures import pictures
from anm_mj.replay.surface import GrowingMesh, growing_mesh
from anm_mj.replay.timeline import Timeline, discs, is_any, leaves
from anm_mj.types import Plan
from anm_mj.utils.picture import jpeg_url
from anm_mj.utils.progress import Progress, unheard
from anm_mj.viz import assets, palette, shapes

MAX_FACES = 300_000
"""Larger meshes are thinned, so that the page stays below some 15 MB."""
MAX_IMAGES = 600
"""Longer runs show every second, third ... image."""
CLIP_PERCENT = (2.0, 98.0)
"""Between these percentiles the colours change."""
LEAST_ERROR_M = 1e-4
"""Smaller errors have one colour: no map and no true surface is as exact."""
SHARDS_PERCENT = 0.2
"""This share of the vertices at each side of the scene may be out of view at first."""
IMAGE_PX = 160
IMAGE_QUALITY = 75
COVERAGE_OF = {"observable": "the observable surface", "completion": "the surface"}


def replay_page(timeline: Timeline, scene: str | None = None, on_progress: Progress = unheard) -> str:
    """The page's HTML. ``scene`` is the present name or folder of its scene, if it has moved; needed where no colour
    images were kept. Progress counts every frame twice. Raises RunFolderError if a file of the run is damaged, and
    MapError if the run's map cannot be read.
    """
    total = 2 * timeline.num_frames
    mesh = growing_mesh(timeline.run, MAX_FACES, lambda done, _: on_progress(done, total))
    images = _images(timeline, scene, lambda done: on_progress(timeline.num_frames + done, total))
    parts = {
        "TITLE": html.escape(timeline.title),
        "STYLE": assets.page_asset("style.css"),
        "LICENCE": assets.bundle_text("main.min.js.LICENSE.txt").replace("--", "- -"),
        "BUNDLE": assets.bundle_text("main.min.js"),
        "DATA": assets.script_json({**_data(timeline, mesh), **images}),
        "PROGRAM": assets.page_asset("theme.js", "view.js", "curve.js", "replay.js"),
    }
    return assets.filled("replay.html", parts)


def pair_page(titles: Sequence[str], pages: Sequence[str]) -> str:
    """The HTML of a page that shows two replays beside each other, from what each is called and its own page."""
    left, right = map(html.escape, titles)
    parts = {
        "TITLE": f"{left} | {right}",
        "LEFT_TITLE": left,
        "RIGHT_TITLE": right,
        "STYLE": assets.page_asset("pair.css"),
        "DATA": assets.script_json(list(pages)),
        "PROGRAM": assets.page_asset("pair.js"),
    }
    return assets.filled("pair.html", parts)


def _data(timeline: Timeline, mesh: GrowingMesh | None) -> dict[str, Any]:
    run = timeline.run
    legend = (*palette.LEGEND, *palette.TRUTH_LEGEND)
    plans, graphs = _plans(timeline)
    name, coverage = timeline.coverage
    low, high = _bounds_m(timeline, mesh)
    poses = [(frame.pose.x_m, frame.pose.y_m, frame.pose.yaw_rad) for frame in run.frames]
    # Column-major, as three.js has it.
    cameras = [frame.T_world_camera.T.ravel() for frame in run.frames]
    camera_height_m = float(run.frames[0].T_world_camera[2, 3])
    return {
        "steps": timeline.steps.tolist(),
        "poses": _base64(np.array(poses, np.float32)),
        "cameras": _base64(np.array(cameras, np.float32)),
        "lost": np.flatnonzero(timeline.is_lost).tolist(),
        "truth": None if timeline.true_xy_m is None else _base64(timeline.true_xy_m.astype(np.float32)),
        "people": [discs(frame).tolist() for frame in run.frames] if is_any(run.frames[0]) else None,
        "doors": [leaves(frame).tolist() for frame in run.frames] if run.frames[0].doors else None,
        "ellipses": _ellipses(timeline),
        "plan_of_frame": timeline.plan_of_frame.tolist(),
        "plans": plans,
        "graphs": graphs,
        "coverage_of": COVERAGE_OF[name],
        "coverage": [None if np.isnan(value) else round(float(value), 2) for value in coverage],
        "mesh": None if mesh is None or not len(mesh.faces) else _mesh(mesh, timeline.num_frames),
        # Of 256 levels, even to the eye.
        "table": _base64(np.rint(255.0 * matplotlib.colormaps["viridis"](np.arange(256))[:, :3]).astype(np.uint8)),
        "frustum": shapes.frustum_corners(run.intrinsics).tolist(),
        "body": {
            "radius": timeline.radius_m,
            "height": shapes.chassis_height_m(camera_height_m),
            "camera": camera_height_m,
        },
        "heights": {
            "graph": shapes.GRAPH_HEIGHT_M,
            "trajectory": shapes.TRAJECTORY_HEIGHT_M,
            "path": shapes.PATH_HEIGHT_M,
        },
        "colours": {key: palette.number(colour) for key, _, colour in legend},
        "legend": legend,
        "low": low.tolist(),
        "high": high.tolist(),
    }


def _bounds_m(timeline: Timeline, mesh: GrowingMesh | None) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Corners of what is to be seen: the surface without shards far beyond a window, and all places of the robot that
    it knew.
    """
    known = timeline.xy_m if timeline.is_lost.all() else timeline.xy_m[~timeline.is_lost]
    xyz = np.pad(known, ((0, 0), (0, 1)))
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    if mesh is not None and len(mesh.vertices_m):
        low = np.minimum(low, np.percentile(mesh.vertices_m, SHARDS_PERCENT, axis=0))
        high = np.maximum(high, np.percentile(mesh.vertices_m, 100.0 - SHARDS_PERCENT, axis=0))
    return low, high


def _ellipses(timeline: Timeline) -> str | None:
    """Half axes and direction of the position's uncertainty at each frame; None where nobody estimated it."""
    found = [timeline.ellipse_m(index) for index in range(timeline.num_frames)]
    if all(each is None for each in found):
        return None
    return _base64(np.array([np.zeros(3) if each is None else each for each in found], np.float32))


def _plans(timeline: Timeline) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The decisions, and the graphs that they refer to by index: many follow one another on the same graph."""
    plans, graphs, index = [], [], None
    for k, line in enumerate(timeline.run.plans):
        record = timeline.plan(k)
        if record.graph is not None:
            graph = _graph(record)
            if index is None or graphs[index] != graph:
                index = len(graphs)
                graphs.append(graph)
        plans.append(
            {
                "reason": line.get("reason", ""),
                "target": line.get("target_xy_m"),
                "path": np.round(record.path_xy_m, 3).ravel().tolist(),
                "graph": index,
            }
        )
    return plans, graphs


def _graph(record: Plan) -> dict[str, Any]:
    assert record.graph is not None
    most = max((region.num_members for region in record.regions), default=1)
    return {
        "vertices": _base64(record.graph.vertex_xy_m.astype(np.float32)),
        "edges": _base64(record.graph.edges.astype(np.uint32)),
        "regions": [
            [*np.round(region.centre_m, 3).tolist(), shapes.region_radius_m(region.num_members, most)]
            for region in record.regions
        ],
    }


def _mesh(mesh: GrowingMesh, num_frames: int) -> dict[str, Any]:
    age = np.rint(255.0 * mesh.first_frame / max(1, num_frames - 1)).astype(np.uint8)
    return {
        "vertices": _base64(mesh.vertices_m),
        "faces": _base64(mesh.faces.astype(np.uint32)),
        "rgb": _base64(mesh.rgb),
        "errors": _errors({"expected error": mesh.error_m, "true error": mesh.true_error_m}),
        "age": _base64(age),
        "counts": _base64(mesh.face_count.astype(np.uint32)),
    }


def _errors(errors_m: dict[str, Float32[np.ndarray, " v"] | None]) -> list[dict[str, str]]:
    """Colourings by errors, all on one scale, so that they can be compared."""
    known = {name: values for name, values in errors_m.items() if values is not None}
    if not known:
        return []
    low, high = np.maximum(np.percentile(np.concatenate(list(known.values())), CLIP_PERCENT), LEAST_ERROR_M)
    ends = {"low": f"≤ {1e3 * low:.2g} mm", "high": f"≥ {1e3 * high:.2g} mm"}
    return [{"name": name, "levels": _base64(levels(values, low, high)), **ends} for name, values in known.items()]


def levels(values: np.ndarray, low: float, high: float) -> UInt8[np.ndarray, " n"]:
    """Values as 0 to 255, in the logarithm, from the lower to the higher bound, both positive."""
    share = np.log(np.maximum(values, low) / low) / max(np.log(high / low), 1e-9)
    return np.rint(255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8)


def _images(timeline: Timeline, scene: str | None, on_progress: Callable[[int], None]) -> dict[str, Any]:
    every = -(-timeline.num_frames // MAX_IMAGES)
    images = []
    for index, rgb in enumerate(pictures(timeline.run, scene)):
        if rgb is not None and index % every == 0:
            images.append(jpeg_url(rgb, IMAGE_PX, IMAGE_QUALITY))
        on_progress(index + 1)
    return {"images": images, "image_of_frame": [index // every for index in range(timeline.num_frames)]}


def _base64(array: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<")).tobytes()).decode()
