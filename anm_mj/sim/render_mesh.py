"""Extracts the visible geometry of a model as one textured mesh, for the ray-casting cameras."""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float32, Int, Int32, UInt8

from anm_mj.mjcf.texture_image import texture_image
from anm_mj.sim.camera import VISIBLE_GROUPS

_RGB = int(mujoco.mjtTextureRole.mjTEXROLE_RGB)
_NO_MATERIAL_RGB = (0.5, 0.5, 0.5)
"""MuJoCo's colour for geoms without one."""


@dataclass(frozen=True, eq=False)
class RenderMesh:
    """Triangles in the world with texture coordinates and colours."""

    vertices_m: Float32[np.ndarray, "v 3"]
    faces: Int32[np.ndarray, "f 3"]
    uv: Float32[np.ndarray, "f 3 2"]
    """Texture coordinates of the corners, v down."""
    texture: Int32[np.ndarray, " f"]
    """Index into ``textures``; -1 for a plain colour."""
    rgb: Float32[np.ndarray, "f 3"]
    """Colour in 0..1; multiplies the texture."""
    textures: tuple[UInt8[np.ndarray, "_ _ 3"], ...]


def visible_geoms(model: mujoco.MjModel, *, moved: bool) -> Int[np.ndarray, " n"]:
    """Ids of the geoms in :data:`VISIBLE_GROUPS` that are not fully transparent: those somebody else moves, such as
    those of people, or all others.
    """
    is_moved = model.body_mocapid[model.geom_bodyid] >= 0
    visible = np.isin(model.geom_group, VISIBLE_GROUPS) & (_rgba(model)[:, 3] > 0.0)
    return np.flatnonzero(visible & (is_moved == moved))


def are_static_meshes(model: mujoco.MjModel, geoms: Int[np.ndarray, " n"]) -> bool:
    """Whether geoms that nobody else moves are meshes that never move; not without any."""
    are_meshes = model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_MESH
    return len(geoms) > 0 and bool((are_meshes & (model.body_weldid[model.geom_bodyid[geoms]] == 0)).all())


def render_mesh(model: mujoco.MjModel, geoms: Int[np.ndarray, " n"]) -> RenderMesh:
    """Static mesh geoms merged into one mesh, world [m]."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    rgba = _rgba(model)
    used_textures: dict[int, int] = {}
    vertices, faces, uv, texture, rgb = [], [], [], [], []
    num_vertices = 0
    for geom in geoms.tolist():
        mesh = model.geom_dataid[geom]
        first, num = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        first_face, num_faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        rotation = data.geom_xmat[geom].reshape(3, 3)
        vertices.append(model.mesh_vert[first : first + num] @ rotation.T + data.geom_xpos[geom])
        faces.append(model.mesh_face[first_face : first_face + num_faces] + num_vertices)
        num_vertices += num
        picture = texture_of(model, geom)
        if picture >= 0 and model.mesh_texcoordnum[mesh]:
            corners = model.mesh_facetexcoord[first_face : first_face + num_faces]
            uv.append(model.mesh_texcoord[model.mesh_texcoordadr[mesh] + corners])
            texture.append(np.full(num_faces, used_textures.setdefault(picture, len(used_textures))))
        else:
            uv.append(np.zeros((num_faces, 3, 2)))
            texture.append(np.full(num_faces, -1))
        rgb.append(np.tile(rgba[geom, :3], (num_faces, 1)))
    return RenderMesh(
        np.concatenate(vertices).astype(np.float32),
        np.concatenate(faces).astype(np.int32),
        np.concatenate(uv).astype(np.float32),
        np.concatenate(texture).astype(np.int32),
        np.concatenate(rgb).astype(np.float32),
        tuple(texture_image(model, picture) for picture in used_textures),
    )


def mean_colours(model: mujoco.MjModel) -> Float32[np.ndarray, "n 3"]:
    """One colour in 0..1 per geom: its own, times the mean of its texture at its vertices."""
    rgb = _rgba(model)[:, :3].astype(np.float32)
    images: dict[int, np.ndarray] = {}
    for geom in range(model.ngeom):
        picture, mesh = texture_of(model, geom), model.geom_dataid[geom]
        if picture < 0:
            continue
        image = images.setdefault(picture, texture_image(model, picture))
        colours = image.reshape(-1, 3)
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH and model.mesh_texcoordnum[mesh]:
            first = model.mesh_texcoordadr[mesh]
            uv = model.mesh_texcoord[first : first + model.mesh_texcoordnum[mesh]]
            cells = np.floor((uv % 1.0) * (image.shape[1], image.shape[0])).astype(np.int64)
            colours = image[cells[:, 1].clip(0, image.shape[0] - 1), cells[:, 0].clip(0, image.shape[1] - 1)]
        rgb[geom] *= colours.mean(axis=0) / 255.0
    return rgb


def texture_of(model: mujoco.MjModel, geom: int) -> int:
    """Index of a geom's two-dimensional texture in the model; -1 if it has none."""
    material = int(model.geom_matid[geom])
    picture = int(model.mat_texid[material, _RGB]) if material >= 0 else -1
    return picture if picture >= 0 and model.tex_type[picture] == mujoco.mjtTexture.mjTEXTURE_2D else -1


def _rgba(model: mujoco.MjModel) -> Float32[np.ndarray, "n 4"]:
    if not model.nmat:
        return model.geom_rgba.copy()
    # As in MuJoCo, the colour of a geom overrides that of its material.
    own = (model.geom_rgba != np.array([*_NO_MATERIAL_RGB, 1.0], np.float32)).any(axis=1) | (model.geom_matid < 0)
    return np.where(own[:, None], model.geom_rgba, model.mat_rgba[model.geom_matid]).astype(np.float32)
