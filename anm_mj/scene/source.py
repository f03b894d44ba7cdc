"""Reads mesh files into parts, in the file's own axes and units."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float64, Integer, UInt8
from PIL import Image

from anm_mj.errors import SceneError
from anm_mj.scene.bake import bake_colours, corner_colours
from anm_mj.scene.part import Part
from anm_mj.scene.source_check import check_source, damaged

if TYPE_CHECKING:
    import trimesh

_MAX_TEXTURE_PX = 1024
"""At the robot's image size, larger textures cost memory and time and look worse (they alias)."""
_PLAIN_RGB = (0.7, 0.7, 0.7)
"""Colour of meshes that have none."""


def read_parts(src: Path) -> list[Part]:
    """Parts of a mesh file with all node transforms applied; colours and textures kept as they are stored.

    JPEG and PNG textures are decoded and reduced to 1024 px; colours per vertex or face become a texture.
    Transparency is not kept: glass is opaque, as to a depth camera that sees it.

    Raises:
        SceneError: if the file is missing, of another kind, empty, damaged, or holds no triangles.
    """
    import trimesh

    check_source(src)
    try:
        # trimesh and its readers raise whatever they stumble over in a damaged file.
        loaded = trimesh.load_scene(src, process=False)
        parts = [part for name, mesh in _placed_meshes(loaded) for part in _parts_of(name, mesh)]
    except SceneError:
        raise
    except Exception as err:
        raise damaged(src, err) from err
    if not any(len(part.faces) for part in parts):
        raise SceneError(f"{src} holds no triangles (a point cloud, or empty): give a mesh with faces.")
    return parts


def _placed_meshes(scene: trimesh.Scene) -> list[tuple[str, trimesh.Trimesh]]:
    """Every mesh of a scene at every place it stands, moved there."""
    import trimesh

    placed = []
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            placed.append((str(name), mesh.copy().apply_transform(transform)))
    return placed


def _parts_of(name: str, mesh: trimesh.Trimesh) -> list[Part]:
    """Parts that look like a mesh."""
    vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    if not np.isfinite(vertices).all():
        bad = int(np.count_nonzero(~np.isfinite(vertices).all(axis=1)))
        raise SceneError(f"Mesh {name!r} has {bad} vertices with NaN or infinite coordinates: repair it.")
    visual: Any = mesh.visual
    if visual.kind == "texture":
        return _textured_parts(name, vertices, faces, visual)
    if visual.kind == "vertex":
        return bake_colours(name, vertices, faces, corner_colours(faces, vertex_rgb=_rgb8(visual.vertex_colors)))
    if visual.kind == "face":
        return bake_colours(name, vertices, faces, corner_colours(faces, face_rgb=_rgb8(visual.face_colors)))
    return [Part(name, vertices, faces, _PLAIN_RGB)]


def _textured_parts(
    name: str, vertices: Float64[np.ndarray, "v 3"], faces: Integer[np.ndarray, "f 3"], visual: Any
) -> list[Part]:
    """Parts of a mesh with a material: texture times factor, or vertex colours times factor, or the factor alone."""
    image, factor = _material(visual.material)
    uv = None if visual.uv is None else np.nan_to_num(np.asarray(visual.uv, dtype=np.float64)[:, :2])
    if image is not None and uv is not None and len(uv) == len(vertices):
        texture = _shrunk(image)
        return [Part(name, vertices, faces, (float(factor[0]), float(factor[1]), float(factor[2])), uv, texture)]
    colours = getattr(visual, "vertex_attributes", {}).get("color")
    vertex_rgb = None if colours is None or len(colours) != len(vertices) else _rgb8(colours)
    return bake_colours(name, vertices, faces, corner_colours(faces, vertex_rgb=vertex_rgb, factor=factor))


def _material(material: Any) -> tuple[Image.Image | None, Float64[np.ndarray, "3"]]:
    """Colour image and colour factor (0..1) of a material, as stored."""
    from trimesh.visual.material import PBRMaterial

    if isinstance(material, PBRMaterial):
        stored = material.baseColorFactor
        # glTF: without a factor, the colour is white.
        factor = np.ones(3) if stored is None else _rgb8(np.asarray(stored)[None])[0] / 255.0
        return material.baseColorTexture, factor
    image = getattr(material, "image", None)
    # In an .mtl the diffuse colour beside a texture is mostly whatever the exporter writes by default (0.4, 0.8, 0).
    return image, np.ones(3) if image is not None else _rgb8(np.asarray(material.main_color)[None])[0] / 255.0


def _rgb8(colours: Any) -> UInt8[np.ndarray, "n 3"]:
    """Colours of any stored kind as 8-bit RGB."""
    colours = np.asarray(colours)[:, :3]
    if colours.dtype == np.uint16:
        return (colours >> 8).astype(np.uint8)
    if colours.dtype.kind == "f":
        return np.round(np.clip(np.nan_to_num(colours), 0.0, 1.0) * 255.0).astype(np.uint8)
    return colours.astype(np.uint8)


def _shrunk(image: Image.Image) -> UInt8[np.ndarray, "h w 3"]:
    """An image as RGB of at most 1024 px a side; the opacity channel is dropped."""
    rgb = image.convert("RGB")
    largest = max(rgb.size)
    if largest > _MAX_TEXTURE_PX:
        size = tuple(max(1, round(side * _MAX_TEXTURE_PX / largest)) for side in rgb.size)
        rgb = rgb.resize((size[0], size[1]), Image.Resampling.LANCZOS)
    return np.array(rgb)
