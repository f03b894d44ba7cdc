"""Colours and textures of geoms, mapped as MuJoCo's renderer maps them, but unlit.

A 2D texture lies on a mesh by its texture coordinates, on a plane, a height field or a mesh without them by projection
along z, and round any other shape; ``texrepeat`` times over the geom, or per metre with ``texuniform``. A cube texture
is looked up by direction.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Float64, UInt8

from anm_mj.mjcf.texture_image import texture_image
from anm_mj.scene.importing.bake_colours import bake_colours
from anm_mj.scene.importing.readers.mjcf.geom_triangles import Shape, half_lengths
from anm_mj.scene.importing.readers.texture_file import MAX_TEXTURE_PX, resized
from anm_mj.scene.submesh import Submesh

_BOX_FACE_PX = 256
"""Resolution to which a cube texture is drawn onto the faces of a box [px]."""


def geom_rgba(model: mujoco.MjModel, geom: int) -> Float64[np.ndarray, "4"]:
    """Colour of a geom: its own, or its material's where its own is the default."""
    own = np.asarray(model.geom_rgba[geom], dtype=np.float64)
    material = int(model.geom_matid[geom])
    if material < 0 or not np.allclose(own, (0.5, 0.5, 0.5, 1.0), atol=1e-6):
        return own
    return np.asarray(model.mat_rgba[material], dtype=np.float64)


@dataclass(frozen=True)
class _Mapping:
    texture: int
    is_cube: bool
    repeat: Float64[np.ndarray, "2"]
    uniform: bool


class Looks:
    """Gives geoms their colours and textures; decodes each texture once."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._textures: dict[int, UInt8[np.ndarray, "h w 3"]] = {}

    def submeshes(self, geom: int, shape: Shape, name: str, part: str) -> list[Submesh]:
        """The submeshes of a geom in its own frame."""
        red, green, blue, _ = np.clip(geom_rgba(self._model, geom), 0.0, 1.0)
        rgb = (float(red), float(green), float(blue))
        plain = Submesh(name, shape.vertices_m, shape.faces, rgb, part=part)
        mapping = self._mapping(geom)
        if mapping is None:
            return [plain]
        picture = self._picture(mapping.texture)
        if (picture == picture[:1, :1]).all():
            red, green, blue = picture[0, 0] / 255.0
            return [replace(plain, rgb=(rgb[0] * float(red), rgb[1] * float(green), rgb[2] * float(blue)))]
        if mapping.is_cube:
            return self._cube(geom, shape, plain, mapping)
        uv = self._coordinates(geom, shape, mapping)
        # Submeshes have v up.
        return [replace(plain, uv=np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1), texture=picture)]

    def _mapping(self, geom: int) -> _Mapping | None:
        model, material = self._model, int(self._model.geom_matid[geom])
        if material < 0:
            return None
        roles = mujoco.mjtTextureRole
        named = [int(model.mat_texid[material, r]) for r in (roles.mjTEXROLE_RGB, roles.mjTEXROLE_RGBA)]
        texture = next((index for index in named if index >= 0), -1)
        kinds = mujoco.mjtTexture
        if texture < 0 or int(model.tex_type[texture]) == kinds.mjTEXTURE_SKYBOX:
            return None
        repeat = np.asarray(model.mat_texrepeat[material], dtype=np.float64)
        is_cube = bool(int(model.tex_type[texture]) == kinds.mjTEXTURE_CUBE)
        return _Mapping(texture, is_cube, repeat, bool(model.mat_texuniform[material]))

    def _picture(self, texture: int) -> UInt8[np.ndarray, "h w 3"]:
        """A texture as stored, the six faces of a cube below one another."""
        if texture not in self._textures:
            stored = texture_image(self._model, texture)
            if int(self._model.tex_type[texture]) != mujoco.mjtTexture.mjTEXTURE_CUBE:
                stored = resized(stored, MAX_TEXTURE_PX)
            self._textures[texture] = stored
        return self._textures[texture]

    def _coordinates(self, geom: int, shape: Shape, mapping: _Mapping) -> Float64[np.ndarray, "v 2"]:
        if shape.texcoord is not None and not shape.repeats:
            return shape.texcoord
        size = half_lengths(self._model, geom)[:2]
        if shape.texcoord is not None:
            return shape.texcoord * (mapping.repeat * size if mapping.uniform else mapping.repeat)
        scale = mapping.repeat
        if not mapping.uniform:
            scale = np.where(size > 0.0, scale / np.where(size > 0.0, size, 1.0), scale)
        return np.stack([0.5 * scale[0] * shape.unit[:, 0] - 0.5, -0.5 * scale[1] * shape.unit[:, 1] - 0.5], axis=1)

    def _cube(self, geom: int, shape: Shape, plain: Submesh, mapping: _Mapping) -> list[Submesh]:
        """A geom with a cube texture: a picture on every face of a box, colours at the corners of anything else."""
        stretch = half_lengths(self._model, geom) if mapping.uniform else np.ones(3)
        faces = _cube_faces(self._picture(mapping.texture))
        if int(self._model.geom_type[geom]) == mujoco.mjtGeom.mjGEOM_BOX:
            return [_box_with_pictures(shape, plain, faces, stretch)]
        colours = _looked_up(faces, (shape.unit * stretch)[shape.faces].reshape(-1, 3)).reshape(-1, 3, 3)
        tinted = np.round(colours * np.array(plain.rgb)).astype(np.uint8)
        baked = bake_colours(plain.name, shape.vertices_m, shape.faces, tinted)
        return [replace(submesh, part=plain.part) for submesh in baked]


def _cube_faces(picture: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "6 w w 3"]:
    """The faces +x, -x, +y, -y, +z, -z of a cube texture; a square picture is all of them."""
    height, width = picture.shape[:2]
    if height < 6 * width:
        return np.broadcast_to(picture[:width], (6, width, width, 3))
    return picture[: 6 * width].reshape(6, width, width, 3)


def _looked_up(faces: UInt8[np.ndarray, "6 w w 3"], directions: Float64[np.ndarray, "n 3"]) -> UInt8[np.ndarray, "n 3"]:
    """Colours of a cube texture in directions, by the cube-map rule of OpenGL (specification, table 8.19)."""
    x, y, z = directions.T
    axis = np.argmax(np.abs(directions), axis=1)
    major = np.take_along_axis(directions, axis[:, None], axis=1)[:, 0]
    face = 2 * axis + (major < 0.0)
    across = np.choose(face, [-z, z, x, x, x, -x])
    down = np.choose(face, [-y, -y, z, -z, -y, -y])
    length = np.maximum(np.abs(major), 1e-12)
    width = faces.shape[1]
    col, row = (
        np.clip((0.5 * (value / length + 1.0) * width).astype(np.int64), 0, width - 1) for value in (across, down)
    )
    return faces[face, row, col]


def _box_with_pictures(
    shape: Shape, plain: Submesh, cube: UInt8[np.ndarray, "6 w w 3"], stretch: Float64[np.ndarray, "3"]
) -> Submesh:
    """A box, four corners a face, with what a cube texture shows on each face; the pictures lie below one another."""
    side = min(cube.shape[1], _BOX_FACE_PX)
    share = (np.arange(side) + 0.5) / side
    right, down = (grid[..., None] for grid in np.meshgrid(share, share))
    pictures, uv = [], np.empty((24, 2))
    for face in range(6):
        # Corners 0 to 3 go round: 0 to 1 is to the right, 0 to 3 upwards in the picture.
        corner = shape.unit[4 * face : 4 * face + 4]
        at = corner[0] + right * (corner[1] - corner[0]) + (1.0 - down) * (corner[3] - corner[0])
        pictures.append(_looked_up(cube, (at * stretch).reshape(-1, 3)).reshape(side, side, 3))
        # Half a texel within the picture, so that the filter does not mix in its neighbour.
        low, high = 0.5 / side, 1.0 - 0.5 / side
        square = np.array([[low, low], [high, low], [high, high], [low, high]])
        uv[4 * face : 4 * face + 4] = np.stack([square[:, 0], (square[:, 1] + 5 - face) / 6.0], axis=1)
    return replace(plain, uv=uv, texture=np.concatenate(pictures), tiled=True)
