"""The colour images of a run with their poses: nerfstudio's ``transforms.json`` and COLMAP's text files."""

import io
import logging
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from scipy.spatial.transform import Rotation

from anm_mj.errors import RunFolderError
from anm_mj.export.surface import surface_points
from anm_mj.frames import T_GL_CV
from anm_mj.io.read_run import Run
from anm_mj.io.to_json import write_json
from anm_mj.io.write import writing
from anm_mj.types import Intrinsics

_logger = logging.getLogger(__name__)

_DEPTH_PIXELS = "first of each block"
"""Which pixels of the camera's image its smaller depth holds; see :mod:`anm_mj.ground_truth.reduced_depth`."""


def export_nerfstudio(run: Run, out: Path) -> list[Path]:
    """``nerfstudio/``: ``transforms.json``, ``images/``, ``depth/`` [mm] and, where the run has a mesh, ``points.ply``.

    Camera axes are those of OpenGL (x right, y up, z backward), as nerfstudio has them. Raises RunFolderError if the
    run kept no images, or the files cannot be written.
    """
    folder = out / "nerfstudio"
    points, colours = surface_points(run)
    camera = _with_images(run, folder / "images")
    with writing(folder):
        (folder / "depth").mkdir(parents=True, exist_ok=True)
        for frame in run.posed_frames:
            depth = run.folder.depth(frame.step)
            (folder / "depth" / depth.name).write_bytes(run.picture_bytes(depth))
        if len(points):
            trimesh.PointCloud(points, colours).export(folder / "points.ply")
    frames = [
        {
            "file_path": f"images/{run.folder.image(frame.step).name}",
            "depth_file_path": f"depth/{run.folder.depth(frame.step).name}",
            "transform_matrix": frame.T_world_camera @ T_GL_CV,
        }
        for frame in run.posed_frames
    ]
    facts = {"camera_model": "OPENCV", "w": camera.width, "h": camera.height}
    facts |= {"fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy}
    facts |= dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0)
    facts |= {"depth_unit_scale_factor": 0.001, "depth_pixels": _DEPTH_PIXELS}
    # The images may be smaller.
    facts["depth_pixels_of"] = [run.intrinsics.width, run.intrinsics.height]
    if len(points):
        facts["ply_file_path"] = "points.ply"
    write_json(folder / "transforms.json", {**facts, "frames": frames})
    return [folder]


def export_colmap(run: Run, out: Path) -> list[Path]:
    """``colmap/``: ``images/`` and ``sparse/0/`` with ``cameras.txt``, ``images.txt`` and ``points3D.txt``.

    Poses map the world to the camera (x right, y down, z forward); the points are vertices of the mesh, without tracks;
    none where the run has no mesh. Raises RunFolderError if the run kept no images, or the files cannot be written.
    """
    folder = out / "colmap"
    points, colours = surface_points(run)
    camera = _with_images(run, folder / "images")
    model = folder / "sparse" / "0"
    with writing(model):
        model.mkdir(parents=True, exist_ok=True)
        numbers = f"{camera.width} {camera.height} {camera.fx!r} {camera.fy!r} {camera.cx!r} {camera.cy!r}"
        (model / "cameras.txt").write_text(
            f"# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 PINHOLE {numbers}\n", encoding="utf-8"
        )
        with (model / "images.txt").open("w", encoding="utf-8") as file:
            file.write("# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n")
            for number, frame in enumerate(run.posed_frames, start=1):
                T = np.linalg.inv(frame.T_world_camera)
                x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
                pose = " ".join(f"{value:.12g}" for value in (w, x, y, z, *T[:3, 3]))
                file.write(f"{number} {pose} 1 {run.folder.image(frame.step).name}\n\n")
        with (model / "points3D.txt").open("w", encoding="utf-8") as file:
            file.write("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n")
            for number, (xyz, rgb) in enumerate(zip(points, colours, strict=True), start=1):
                file.write(f"{number} {xyz[0]:.6g} {xyz[1]:.6g} {xyz[2]:.6g} {rgb[0]} {rgb[1]} {rgb[2]} 0\n")
    return [folder]


def image_intrinsics(run: Run) -> Intrinsics:
    """Intrinsics of the images that a run kept, at their own size. Raises RunFolderError if it kept none."""
    first = run.folder.image(run.frames[0].step) if run.frames else run.folder.image(0)
    if not first.is_file():
        raise RunFolderError(f"{run.folder.path} keeps no colour images; explore with --keep-images.")
    with Image.open(io.BytesIO(run.picture_bytes(first))) as image:
        width, height = image.size
    return run.intrinsics.scaled(width, height)


def _with_images(run: Run, folder: Path) -> Intrinsics:
    """Copy the images of a run whose pose was known, and give their intrinsics."""
    camera = image_intrinsics(run)
    if not run.posed_frames:
        raise RunFolderError(f"{run.folder.path} holds no frame whose pose was known; give another run.")
    if camera.width < run.intrinsics.width:
        _logger.warning(
            "The images have %d x %d pixels of %d x %d, which is little to reconstruct from; explore with "
            "--keep-images.",
            camera.width,
            camera.height,
            run.intrinsics.width,
            run.intrinsics.height,
        )
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for frame in run.posed_frames:
            image = run.folder.image(frame.step)
            (folder / image.name).write_bytes(run.picture_bytes(image))
    return camera
