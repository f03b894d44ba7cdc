"""Light for worlds that have none: of one colour in all directions, a wall and the next would show no corner."""

from dataclasses import replace

import numpy as np

from anm_mj.scene.raster import normals
from anm_mj.scene.submesh import Submesh, only_faces

LIGHT = np.array([0.45, 0.15, 0.88])
"""Towards the light: the six sides of a room differ by at least 6 % in brightness."""
DARKEST, LEVELS = 0.55, 16
"""Brightness of what faces away from the light, and how many there are from there to full."""


def shaded(submeshes: list[Submesh]) -> list[Submesh]:
    """Submeshes in the world, darker where they face away from a light above and to one side.

    A world with a texture stays as it is: photographs and baked colours have their own light.
    """
    if any(submesh.texture is not None for submesh in submeshes):
        return submeshes
    return [part for submesh in submeshes for part in _by_brightness(submesh)]


def _by_brightness(submesh: Submesh) -> list[Submesh]:
    normal = normals(submesh.vertices_m[submesh.faces])
    lengths = np.linalg.norm(normal, axis=1)
    towards = np.divide(normal @ LIGHT, lengths, out=np.zeros(len(lengths)), where=lengths > 0.0)
    level = np.rint((LEVELS - 1) * (towards / np.linalg.norm(LIGHT) + 1.0) / 2.0).astype(np.int64)
    red, green, blue = submesh.rgb
    parts = []
    for each in np.unique(level):
        share = DARKEST + (1.0 - DARKEST) * float(each) / (LEVELS - 1)
        rgb = (share * red, share * green, share * blue)
        parts.append(replace(only_faces(submesh, level == each), rgb=rgb, uv=None))
    return parts
