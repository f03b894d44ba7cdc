"""The MJCF of a scene: unlit visual meshes, collision boxes and an infinite floor."""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Float64, Int32, Integer
from scipy.spatial.transform import Rotation

from anm_mj.scene.movable import Movable
from anm_mj.utils.read_file import MAX_ARRAY_MIB, read_bytes

VISUAL_GROUP = 2
"""Geom group that the camera sees."""
COLLISION_GROUP = 3
"""Geom group that the robot collides with: boxes and the floor plane, hidden from the camera."""
BOX_TOP_M = 1.5
"""Height of the collision boxes: a little above the slice that they cover [m]."""
ZNEAR_M = 0.02
MIN_VERTICES = 4
_MIN_ZFAR_M = 100.0
_ROUNDING = 1e-7
"""More than the share by which rounding changes a number that is written."""


@dataclass(frozen=True)
class Drawn:
    """A submesh as it lies in the assets folder."""

    name: str
    mesh_file: str
    texture_file: str | None
    rgb: tuple[float, float, float]
    part: str = ""
    """Of a movable object that it belongs to."""


def scene_mjcf(
    name: str,
    drawn: list[Drawn],
    boxes_m: Float[np.ndarray, "n 4"],
    bounds_m: Float[np.ndarray, "2 3"],
    movables: tuple[Movable, ...] = (),
) -> str:
    """MJCF text of a scene whose assets lie in ``assets/``.

    A headlight of ambient 1 as the only light shows textures in their stored colours, as scans with baked light need.
    With extent 1, znear and zfar are in metres.
    """
    root = ET.Element("mujoco", model=name)
    ET.SubElement(root, "compiler", angle="radian", meshdir="assets", texturedir="assets", autolimits="true")
    ET.SubElement(root, "option", timestep="0.002", integrator="implicitfast", cone="elliptic")
    extents = bounds_m[1] - bounds_m[0]
    ET.SubElement(root, "statistic", extent="1", center=_numbers(bounds_m.mean(axis=0)))
    visual = ET.SubElement(root, "visual")
    ET.SubElement(visual, "global", offwidth="1920", offheight="1080")
    ET.SubElement(visual, "quality", offsamples="0", shadowsize="0")
    ET.SubElement(visual, "headlight", ambient="1 1 1", diffuse="0 0 0", specular="0 0 0")
    zfar_m = max(_MIN_ZFAR_M, math.ceil(float(np.linalg.norm(extents))))
    ET.SubElement(visual, "map", znear=f"{ZNEAR_M:g}", zfar=f"{zfar_m:g}")

    default = ET.SubElement(root, "default")
    look = ET.SubElement(ET.SubElement(default, "default", {"class": "visual"}), "geom", type="mesh")
    look.attrib.update(contype="0", conaffinity="0", group=str(VISUAL_GROUP), mass="0")
    bump = ET.SubElement(ET.SubElement(default, "default", {"class": "collision"}), "geom", type="box")
    bump.attrib.update(group=str(COLLISION_GROUP), rgba="0.9 0.4 0.2 0.4")

    asset, world = ET.SubElement(root, "asset"), ET.SubElement(root, "worldbody")
    textures: set[str] = set()
    bodies = {movable.part: (movable, _movable_body(world, asset, movable, i)) for i, movable in enumerate(movables)}
    for submesh in drawn:
        material = ET.SubElement(asset, "material", name=submesh.name, rgba=_numbers((*submesh.rgb, 1.0)))
        material.attrib.update(specular="0", shininess="0", reflectance="0")
        if submesh.texture_file is not None:
            texture = Path(submesh.texture_file).stem
            material.set("texture", texture)
            if texture not in textures:
                textures.add(texture)
                ET.SubElement(asset, "texture", name=texture, type="2d", file=submesh.texture_file)
        ET.SubElement(asset, "mesh", name=submesh.name, file=submesh.mesh_file, inertia="shell")
        look = {"class": "visual", "name": submesh.name, "mesh": submesh.name, "material": submesh.name}
        if submesh.part in bodies:
            # Its mesh is stored where it stands at first.
            movable, body = bodies[submesh.part]
            ET.SubElement(body, "geom", look | _pose(np.linalg.inv(movable.T_world_object)))
        else:
            ET.SubElement(world, "geom", look)
    floor = ET.SubElement(world, "geom", {"class": "collision"}, name="floor", type="plane", size="0 0 1")
    floor.set("rgba", "0.5 0.5 0.5 0.2")
    for i, (x_min, y_min, x_max, y_max) in enumerate(boxes_m):
        centre = ((x_min + x_max) / 2, (y_min + y_max) / 2, BOX_TOP_M / 2)
        half = ((x_max - x_min) / 2, (y_max - y_min) / 2, BOX_TOP_M / 2)
        ET.SubElement(world, "geom", {"class": "collision"}, name=f"box_{i}", pos=_numbers(centre), size=_numbers(half))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _movable_body(world: ET.Element, asset: ET.Element, movable: Movable, index: int) -> ET.Element:
    name = f"movable_{index}"
    body = ET.SubElement(world, "body", {"name": name} | _pose(movable.T_world_object))
    ET.SubElement(body, "freejoint", name=name)
    inertia = _exact(_written_inertia(movable.inertia_kgm2)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    inertial = ET.SubElement(body, "inertial", pos=_exact(movable.centre_m), mass=f"{movable.mass_kg:.9g}")
    inertial.set("fullinertia", inertia)
    for i, solid in enumerate(movable.solids):
        geom = ET.SubElement(body, "geom", {"class": "collision"}, name=f"{name}_{i}", type=solid.kind)
        geom.attrib.update(pos=_exact(solid.position_m), quat=_exact(solid.quaternion))
        geom.set("friction", _exact(np.array(solid.friction)))
        if solid.hull_m is None:
            geom.set("size", _exact(np.array(solid.size_m)))
        else:
            hull = _exact(np.unique(solid.hull_m.round(6), axis=0).ravel())
            ET.SubElement(asset, "mesh", name=f"{name}_{i}", vertex=hull)
            geom.set("mesh", f"{name}_{i}")
    return body


def _written_inertia(inertia_kgm2: Float64[np.ndarray, "3 3"]) -> Float64[np.ndarray, "3 3"]:
    """An inertia that MuJoCo takes when its numbers are rounded: it refuses a disc that is flatter, or a rod that is
    thinner, than anything can be.
    """
    moments, axes = np.linalg.eigh(inertia_kgm2)
    thin, middle, most = moments.tolist()
    thin = max(thin, _ROUNDING * most)
    most = min(most, (1.0 - _ROUNDING) * (thin + middle))
    return inertia_kgm2 + axes @ np.diag([thin, middle, most] - moments) @ axes.T


def _pose(T: Float[np.ndarray, "4 4"]) -> dict[str, str]:
    """Attributes of a pose; the quaternion is scalar first."""
    quaternion = Rotation.from_matrix(T[:3, :3]).as_quat()[[3, 0, 1, 2]]
    return {"pos": _exact(T[:3, 3]), "quat": _exact(quaternion)}


def _exact(values: Float[np.ndarray, " n"]) -> str:
    return " ".join(f"{float(value):.9g}" for value in values)


def _numbers(values: Float[np.ndarray, " n"] | tuple[float, ...]) -> str:
    """Numbers of MJCF, rounded to a hundredth of a millimetre."""
    return " ".join(f"{round(float(value), 5):g}" for value in values)


def write_msh(
    path: Path,
    vertices_m: Float[np.ndarray, "v 3"],
    faces: Integer[np.ndarray, "f 3"],
    uv: Float[np.ndarray, "v 2"] | None,
) -> None:
    """Write a mesh in MuJoCo's binary format, which loads several times as fast as .obj.

    MuJoCo needs at least four vertices: a smaller mesh repeats its last one.

    Layout: four int32 counts (vertices, normals, texture coordinates, faces), then float32 vertices, texture
    coordinates (v down) and int32 faces.
    """
    missing = (0, max(0, MIN_VERTICES - len(vertices_m)))
    vertices_m = np.pad(vertices_m, (missing, (0, 0)), mode="edge")
    uv = None if uv is None else np.pad(uv, (missing, (0, 0)), mode="edge")
    counts = np.array([len(vertices_m), 0, 0 if uv is None else len(uv), len(faces)], dtype="<i4")
    with path.open("wb") as file:
        file.write(counts.tobytes())
        file.write(np.ascontiguousarray(vertices_m, dtype="<f4").tobytes())
        if uv is not None:
            file.write(np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1).astype("<f4").tobytes())
        file.write(np.ascontiguousarray(faces, dtype="<i4").tobytes())


def read_msh(path: Path) -> tuple[Float32[np.ndarray, "v 3"], Float32[np.ndarray, "w 2"], Int32[np.ndarray, "f 3"]]:
    """Read a file of ``write_msh``: vertices, texture coordinates (v down; none, or one per vertex) and faces. Raises
    OSError if the file cannot be read, and ValueError if it is no such file.
    """
    data = read_bytes(path, MAX_ARRAY_MIB)
    num_vertices, num_normals, num_uv, num_faces = np.frombuffer(data, dtype="<i4", count=4).tolist()
    counts = np.cumsum([4, 3 * num_vertices, 3 * num_normals, 2 * num_uv, 3 * num_faces])
    if len(data) != 4 * counts[-1]:
        raise ValueError(f"{path} is {len(data)} bytes long instead of {4 * counts[-1]}")
    values = np.frombuffer(data, dtype="<f4")
    vertices, uv = values[counts[0] : counts[1]], values[counts[2] : counts[3]]
    faces = np.frombuffer(data, dtype="<i4", offset=4 * int(counts[3]))
    return vertices.reshape(-1, 3), uv.reshape(-1, 2), faces.reshape(-1, 3)
