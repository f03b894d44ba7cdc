"""A whole run as one MCAP file with Foxglove's message types in JSON, for Foxglove Studio and the ``mcap`` readers."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from anm_mj.errors import RunFolderError
from anm_mj.export.images import image_intrinsics
from anm_mj.export.surface import surface_points
from anm_mj.io.plan_file import PlanRecord
from anm_mj.io.read_run import Run
from anm_mj.io.run_records import FrameRecord
from anm_mj.io.write import writing
from anm_mj.replay.pictures import kept_images
from anm_mj.replay.timeline import Timeline
from anm_mj.types import Intrinsics
from anm_mj.utils.progress import Progress, unheard
from anm_mj.viz import palette

FLOAT32 = 7
"""Foxglove's number of the type of a field of a point cloud; 1 is uint8."""
LINE_LIST, LINE_STRIP = 2, 0
Write = Callable[[str, str, FrameRecord, dict[str, Any]], None]


def export_mcap(run: Run, out: Path, on_progress: Progress = unheard) -> list[Path]:
    """``run.mcap``: poses, images, depth, calibration, decisions, completion and the points of the final surface.
    Raises RunFolderError if the package mcap is missing, a file of the run is damaged, or the file cannot be written.
    """
    try:
        from mcap.writer import Writer
    except ImportError as err:
        raise RunFolderError("MCAP files need the package mcap: pip install 'anm-mj[mcap]'.") from err
    timeline, path = Timeline(run), out / "run.mcap"
    with writing(path), path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="anm_mj")
        channels: dict[str, int] = {}

        def write(topic: str, schema: str, frame: FrameRecord, message: dict[str, Any]) -> None:
            if topic not in channels:
                number = writer.register_schema(schema, "jsonschema", b'{"type": "object"}')
                channels[topic] = writer.register_channel(topic, "json", number)
            at = round(frame.time_s * 1e9)
            writer.add_message(channels[topic], at, json.dumps(message).encode(), at)

        camera = image_intrinsics(run) if kept_images(run) else None
        for index, frame in enumerate(run.frames):
            _write_frame(timeline, index, frame, write)
            if camera is not None:
                _write_image(run, frame, camera, write)
            on_progress(index + 1, timeline.num_frames)
        if run.folder.mesh.is_file():
            write("/map/surface", "foxglove.PointCloud", run.frames[-1], _points(run, run.frames[-1]))
        writer.finish()
    return [path]


def _write_frame(timeline: Timeline, index: int, frame: FrameRecord, write: Write) -> None:
    run = timeline.run
    stamp = _stamp(frame)
    half = frame.pose.yaw_rad / 2.0
    base = {
        "position": {"x": frame.pose.x_m, "y": frame.pose.y_m, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": float(np.sin(half)), "w": float(np.cos(half))},
    }
    write("/robot/pose", "foxglove.PoseInFrame", frame, {"timestamp": stamp, "frame_id": "world", "pose": base})
    x, y, z, w = Rotation.from_matrix(frame.T_world_camera[:3, :3]).as_quat().tolist()
    tx, ty, tz = frame.T_world_camera[:3, 3].tolist()
    transform = {
        "timestamp": stamp,
        "parent_frame_id": "world",
        "child_frame_id": "camera",
        "translation": {"x": tx, "y": ty, "z": tz},
        "rotation": {"x": x, "y": y, "z": z, "w": w},
    }
    write("/tf", "foxglove.FrameTransform", frame, transform)
    depth = run.depth_mm(frame)
    raw = {"encoding": "16UC1", "step": 2 * depth.shape[1], "height": depth.shape[0], "width": depth.shape[1]}
    head = {"timestamp": stamp, "frame_id": "camera"}
    write("/camera/depth", "foxglove.RawImage", frame, head | raw | {"data": _base64(depth.astype("<u2").tobytes())})
    decided = int(timeline.plan_of_frame[index])
    if decided >= 0 and run.plans[decided]["step"] == frame.step:
        line = run.plans[decided]
        said = {"timestamp": stamp, "level": 2, "message": line.get("reason", ""), "name": "policy"}
        write("/plan/reason", "foxglove.Log", frame, said)
        write("/plan/scene", "foxglove.SceneUpdate", frame, _scene(timeline.plan(decided), stamp))
    name, values = timeline.coverage
    if not np.isnan(values[index]):
        covered = {"timestamp": stamp, "step": frame.step, f"{name}_percent": float(values[index])}
        write("/completion", "anm_mj.Completion", frame, covered)


def _write_image(run: Run, frame: FrameRecord, camera: Intrinsics, write: Write) -> None:
    head = {"timestamp": _stamp(frame), "frame_id": "camera"}
    data = _base64(run.picture_bytes(run.folder.image(frame.step)))
    write("/camera/image", "foxglove.CompressedImage", frame, head | {"format": "jpeg", "data": data})
    write("/camera/calibration", "foxglove.CameraCalibration", frame, head | _calibration(camera))


def _scene(plan: PlanRecord, stamp: dict[str, int]) -> dict[str, Any]:
    lines = []
    if plan.graph is not None:
        ends_xy_m = plan.graph.vertex_xy_m[plan.graph.edges].reshape(-1, 2)
        lines.append(_line(LINE_LIST, ends_xy_m, palette.GRAPH, 0.025))
    if len(plan.path_xy_m):
        lines.append(_line(LINE_STRIP, plan.path_xy_m, palette.PATH, 0.05))
    entity = {
        "timestamp": stamp,
        "frame_id": "world",
        "id": "plan",
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
        "lines": lines,
    }
    return {"deletions": [], "entities": [entity]}


def _line(kind: int, xy_m: np.ndarray, colour: str, thickness_m: float) -> dict[str, Any]:
    red, green, blue = (int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    return {
        "type": kind,
        "pose": {"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}},
        "thickness": thickness_m,
        "scale_invariant": False,
        "points": [{"x": x, "y": y, "z": 0.03} for x, y in np.round(xy_m, 3).tolist()],
        "color": {"r": red, "g": green, "b": blue, "a": 1.0},
        "colors": [],
        "indices": [],
    }


def _points(run: Run, frame: FrameRecord) -> dict[str, Any]:
    points, colours = surface_points(run)
    packed = np.zeros(len(points), [("xyz", "<f4", 3), ("rgb", "u1", 3), ("alpha", "u1")])
    packed["xyz"], packed["rgb"], packed["alpha"] = points, colours, 255
    fields = [{"name": name, "offset": 4 * k, "type": FLOAT32} for k, name in enumerate("xyz")]
    fields += [{"name": name, "offset": 12 + k, "type": 1} for k, name in enumerate(("red", "green", "blue", "alpha"))]
    return {
        "timestamp": _stamp(frame),
        "frame_id": "world",
        "pose": {"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}},
        "point_stride": packed.itemsize,
        "fields": fields,
        "data": _base64(packed.tobytes()),
    }


def _calibration(camera: Intrinsics) -> dict[str, Any]:
    # Foxglove and ROS measure the principal point from the centre of the first pixel.
    cx, cy = camera.cx - 0.5, camera.cy - 0.5
    return {
        "width": camera.width,
        "height": camera.height,
        "distortion_model": "plumb_bob",
        "D": [0.0] * 5,
        "K": [camera.fx, 0.0, cx, 0.0, camera.fy, cy, 0.0, 0.0, 1.0],
        "R": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "P": [camera.fx, 0.0, cx, 0.0, 0.0, camera.fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }


def _stamp(frame: FrameRecord) -> dict[str, int]:
    sec, nsec = divmod(round(frame.time_s * 1e9), 10**9)
    return {"sec": sec, "nsec": nsec}


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()
