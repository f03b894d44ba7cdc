"""Reads mesh files into submeshes, in the file's own axes and units (metres where the file states its unit)."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float64, Integer, UInt8
from PIL import Image

from anm_mj.errors import SceneError
from anm_mj.scene.importing.bake_colours import bake_colours
from anm_mj.scene.importing.readers.collada_check import even_collada
from anm_mj.scene.importing.readers.gltf_file import even_gltf
from anm_mj.scene.importing.readers.import_limits import check_textures
from anm_mj.scene.importing.readers.import_report import LEFT_OUT, ImportReport, MeshFacts, damaged
from anm_mj.scene.importing.readers.mesh_check import check_mesh_file
from anm_mj.scene.importing.readers.obj_check import even_text
from anm_mj.scene.importing.readers.obj_material import even_materials
from anm_mj.scene.importing.readers.parsed_scene import ParsedScene
from anm_mj.scene.importing.readers.ply_faces import even_ply
from anm_mj.scene.importing.readers.texture_file import MAX_TEXTURE_PX, MeshNeighbours, TextureStore
from anm_mj.scene.submesh import Submesh

if TYPE_CHECKING:
    import trimesh

PLAIN_RGB = (0.7, 0.7, 0.7)
"""Colour of meshes that have none."""

_HEAD_BYTES = 65536
"""A COLLADA file states its unit and its up axis within this many bytes."""


def read_mesh_scene(src: Path, model_paths: Sequence[Path], report: ImportReport) -> ParsedScene:
    """A scene in one mesh file of no known data set. Raises SceneError as :func:`read_mesh`."""
    del model_paths
    return ParsedScene(read_mesh(src, report), source=src.name, up=usual_up(src))


def usual_up(src: Path) -> Literal["x", "y", "z"]:
    """The axis that usually points up in such a file, or that the file states."""
    suffix = src.suffix.lower()
    if suffix == ".dae":
        stated = re.search(rb"<up_axis>\s*([XYZ])_UP", _head(src))
        axis = b"Y" if stated is None else stated[1]
        return "x" if axis == b"X" else "y" if axis == b"Y" else "z"
    if suffix in (".ply", ".stl"):
        return "z"
    # A navigation mesh beside a .glb is one of Habitat's, whose scans are z up.
    return "z" if suffix == ".glb" and src.with_suffix(".navmesh").is_file() else "y"


def read_mesh(src: Path, report: ImportReport) -> list[Submesh]:
    """Submeshes of a mesh file with all node transforms applied; colours and textures kept as they are stored.

    JPEG, PNG and WebP textures are decoded and reduced to 1024 px; colours per vertex or face become a texture.
    Transparency is not kept: glass is opaque, as to a depth camera that sees it. A COLLADA file's unit is applied, its
    up axis is not. The report gets what the file refers to and is missing. Raises SceneError if the file is missing, of
    another format, empty, damaged, too large, or holds no triangles.
    """
    import trimesh

    facts = check_mesh_file(src, report)
    unit_m = _collada_unit_m(src) if src.suffix.lower() == ".dae" else 1.0
    store = TextureStore()
    try:
        # trimesh and its readers raise whatever they stumble over in a damaged file.
        neighbours = MeshNeighbours(src, report, partial(even_materials, latin=facts.latin))
        content = _even_content(src, facts)
        loaded = trimesh.load_scene(content, src.suffix[1:], process=False, resolver=neighbours)
        if facts.draco:
            _require_decoded(src, loaded)
        placed = _placed_meshes(loaded, unit_m, src.suffix.lower())
        pictures = {id(image): image.size for mesh in placed if (image := _picture(mesh)) is not None}
        check_textures(src, pictures.values(), MAX_TEXTURE_PX)
        submeshes = [replace(submesh, part=mesh.part) for mesh in placed for submesh in _submeshes_of(mesh, store)]
    except SceneError:
        raise
    except Exception as err:
        raise damaged(src, err) from err
    for name in facts.geometries:
        if name not in loaded.geometry:
            report.add(LEFT_OUT, f"geometry {name!r} of {src.name}")
    if not any(len(submesh.faces) for submesh in submeshes):
        raise SceneError(
            f"{src} holds no triangles (a point cloud, Gaussian splats, or nothing): reconstruct its surface, as "
            "MeshLab does, or give the mesh of the program that made it."
        )
    if neighbours.missed or not facts.decodable:
        # White is what is left of a material whose texture is missing; white walls would be lost against one another.
        return [
            replace(submesh, rgb=PLAIN_RGB)
            if submesh.texture is None and submesh.uv is not None and min(submesh.rgb) > 0.99
            else submesh
            for submesh in submeshes
        ]
    return submeshes


def _even_content(src: Path, facts: MeshFacts) -> io.BytesIO | Path:
    """What the library is to read: the file, or what it holds as the library expects it."""
    suffix, content = src.suffix.lower(), None
    if suffix == ".ply":
        content = even_ply(src)
    elif facts.uneven:
        even_obj = partial(even_text, unmapped=facts.unmapped, latin=facts.latin)
        content = {".obj": even_obj, ".dae": even_collada}.get(suffix, even_gltf)(src)
    return src if content is None else io.BytesIO(content)


def _require_decoded(src: Path, scene: trimesh.Scene) -> None:
    """Refuse a scene with Draco-compressed triangles that were not decoded, for which the library leaves zeros."""
    import trimesh

    for name, mesh in scene.geometry.items():
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces) and not (mesh.faces.any() and mesh.vertices.any()):
            raise SceneError(
                f"{src} has Draco-compressed triangles that cannot be decoded (mesh {name!r}): export it without "
                "compression."
            )


def _head(src: Path) -> bytes:
    with src.open("rb") as file:
        return file.read(_HEAD_BYTES)


def _collada_unit_m(src: Path) -> float:
    stated = re.search(rb"<unit[^>]*\bmeter\s*=\s*[\"']([0-9.eE+-]+)[\"']", _head(src))
    try:
        unit_m = float(stated[1]) if stated else 1.0
    except ValueError:
        unit_m = 1.0
    return unit_m if unit_m > 0.0 else 1.0


class _PlacedMesh(NamedTuple):
    name: str
    part: str
    """Name of the node that places it."""
    vertices: Float64[np.ndarray, "v 3"]
    faces: Integer[np.ndarray, "f 3"]
    visual: Any
    colours: Any = None
    """Colours of its vertices beside a material, as stored; None without."""


def _placed_meshes(scene: trimesh.Scene, unit_m: float, suffix: str) -> list[_PlacedMesh]:
    import trimesh

    placed, beside = [], _beside_materials(scene, suffix)
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        # Not by a copy of the mesh, which would copy its images.
        vertices = np.asarray(mesh.vertices, dtype=np.float64) @ transform[:3, :3].T + transform[:3, 3]
        faces = np.asarray(mesh.faces, dtype=np.int64)
        if np.linalg.det(transform[:3, :3]) < 0.0:
            faces = faces[:, ::-1]
        colours = getattr(mesh.visual, "vertex_attributes", {}).get("color")
        # In the order of the vertices, which those of a PLY file with texture coordinates do not keep.
        colours = mesh.vertex_attributes.get("color") if colours is None and beside else colours
        part = _node_name(scene, node).replace("/", "_")
        placed.append(_PlacedMesh(str(name), part, vertices * unit_m, faces, mesh.visual, colours))
    return placed


def _node_name(scene: trimesh.Scene, node: Any) -> str:
    """The name of a node as its file has it: for each material of a glTF node the library makes a node below it, whose
    name ends in six random letters.
    """
    name, above = str(node), str(scene.graph.transforms.parents.get(node, ""))
    mesh = scene.geometry[scene.graph[node][1]]
    is_made = mesh.metadata.get("from_gltf_primitive") and len(name) == len(above) + 7 and name.startswith(f"{above}_")
    return above if is_made else name


def _beside_materials(scene: trimesh.Scene, suffix: str) -> bool:
    """Whether a file has colours of vertices beside its materials that say more than these: some exporters write the
    same colour for every vertex.
    """
    import trimesh

    if suffix not in (".obj", ".dae"):
        return False
    meshes = [mesh for mesh in scene.geometry.values() if isinstance(mesh, trimesh.Trimesh)]
    stored = [colours for mesh in meshes if (colours := mesh.vertex_attributes.get("color")) is not None]
    read = [_rgb8(colours) for colours in stored if len(colours)]
    return any((colours != read[0][0]).any() for colours in read)


def _picture(mesh: _PlacedMesh) -> Image.Image | None:
    return _material(mesh.visual.material)[0] if mesh.visual.kind == "texture" else None


def _submeshes_of(mesh: _PlacedMesh, store: TextureStore) -> list[Submesh]:
    name, _, vertices, faces, visual, _ = mesh
    if not np.isfinite(vertices).all():
        bad = int(np.count_nonzero(~np.isfinite(vertices).all(axis=1)))
        raise SceneError(f"Mesh {name!r} has {bad} vertices with NaN or infinite coordinates: repair it.")
    if visual.kind == "texture":
        return _textured_submeshes(mesh, store)
    if visual.kind == "vertex":
        return bake_colours(name, vertices, faces, _rgb8(visual.vertex_colors)[faces])
    if visual.kind == "face":
        return bake_colours(name, vertices, faces, np.repeat(_rgb8(visual.face_colors)[:, None], 3, axis=1))
    return [Submesh(name, vertices, faces, PLAIN_RGB)]


def _textured_submeshes(mesh: _PlacedMesh, store: TextureStore) -> list[Submesh]:
    """Submeshes of a mesh with a material: texture times factor, else vertex colours times factor, else the factor."""
    name, _, vertices, faces, visual, colours = mesh
    image, factor = _material(visual.material)
    uv = None if visual.uv is None else np.nan_to_num(np.asarray(visual.uv, dtype=np.float64)[:, :2])
    if uv is not None and len(uv) != len(vertices):
        uv = None
    rgb = (float(factor[0]), float(factor[1]), float(factor[2]))
    if image is not None and uv is not None:
        return [Submesh(name, vertices, faces, rgb, uv, store.texture(image))]
    if colours is None or len(colours) != len(vertices):
        # Texture coordinates without a texture are kept for a world that brings the texture.
        return [Submesh(name, vertices, faces, rgb, uv)]
    return bake_colours(name, vertices, faces, np.round(_rgb8(colours)[faces] * factor).astype(np.uint8))


def _material(material: Any) -> tuple[Image.Image | None, Float64[np.ndarray, "3"]]:
    """Colour image and colour factor (0..1) of a material, as stored; those of its light where it is black."""
    from trimesh.visual.material import PBRMaterial

    if isinstance(material, PBRMaterial):
        stored = material.baseColorFactor
        # glTF: without a factor, the colour is white.
        factor = np.ones(3) if stored is None else _rgb8(np.asarray(stored)[None])[0] / 255.0
        light = material.emissiveFactor
        if light is not None and np.any(light) and not factor.any():
            # A lamp, a screen, or a scene whose light is baked.
            return material.emissiveTexture, _rgb8(np.asarray(light, dtype=np.float64)[None])[0] / 255.0
        return material.baseColorTexture, factor
    image = getattr(material, "image", None)
    # In an .mtl the diffuse colour beside a texture is mostly whatever the exporter writes by default (0.4, 0.8, 0).
    return image, np.ones(3) if image is not None else _rgb8(np.asarray(material.main_color)[None])[0] / 255.0


def _rgb8(colours: Any) -> UInt8[np.ndarray, "n 3"]:
    colours = np.asarray(colours)[:, :3]
    if colours.dtype == np.uint16:
        return (colours >> 8).astype(np.uint8)
    if colours.dtype.kind == "f":
        return np.round(np.clip(np.nan_to_num(colours), 0.0, 1.0) * 255.0).astype(np.uint8)
    return colours.astype(np.uint8)
