"""One furnished room in many files: red floor, green and blue walls, a table, and a picture in four colours."""

import numpy as np
import trimesh
from PIL import Image

from tests.scene.shapes import box, room, table

RED, GREEN, BLUE, YELLOW, WOOD = (200, 30, 30), (30, 180, 30), (40, 40, 220), (230, 220, 30), (150, 100, 60)
BOUNDS_M = ((-0.1, -0.1, -0.1), (6.1, 4.1, 2.6))
"""Of the room, its walls and floor included."""


def picture() -> Image.Image:
    """Red and green above, blue and yellow below."""
    image = np.zeros((64, 64, 3), dtype=np.uint8)
    image[:32, :32], image[:32, 32:], image[32:, :32], image[32:, 32:] = RED, GREEN, BLUE, YELLOW
    return Image.fromarray(image)


def poster() -> trimesh.Trimesh:
    """The picture on the wall at y = 3.99 m, from x = 2 to 4 m and z = 0.5 to 2.5 m."""
    corners = np.array([[2.0, 3.99, 0.5], [4.0, 3.99, 0.5], [4.0, 3.99, 2.5], [2.0, 3.99, 2.5]])
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    visual = trimesh.visual.TextureVisuals(
        uv=uv, material=trimesh.visual.material.PBRMaterial(baseColorTexture=picture())
    )
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)


def furnished() -> list[trimesh.Trimesh]:
    """The room with the picture, a table and a cupboard, z up."""
    return [room(), poster(), table(2.0, 1.0), box((0.0, 0.0, 0.0), (0.5, 1.0, 1.8))]


def looks_at_the_poster(scene) -> bool:
    """Whether a camera in the room sees the four colours where they belong."""
    from tests.scene.view import look

    seen = look(scene, (3.0, 2.9, 1.5), (1.0, 0.0, 0.0))
    quadrants = [seen[row, col] for row in (22, 42) for col in (22, 42)]
    return bool(np.abs(np.array(quadrants, dtype=int) - [RED, GREEN, BLUE, YELLOW]).max() <= 6)


def write_glb(path, *meshes, y_up: bool = False):
    """A .glb of meshes, turned to y up if asked, in a folder that is made."""
    from tests.scene.shapes import to_y_up

    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.Scene([to_y_up(mesh) if y_up else mesh for mesh in meshes]).export(path)
    return path


def write_obj(path, *, y_up: bool = False, texture: str = "picture.jpg", colour: tuple[float, ...] = (0, 0.4, 1)):
    """The furnished room as .obj, .mtl and picture; all but the poster in one colour."""
    path.parent.mkdir(parents=True, exist_ok=True)
    plain = trimesh.util.concatenate([mesh for mesh in furnished() if len(mesh.faces) > 2])
    turn = (lambda v: (v[0], v[2], -v[1])) if y_up else tuple
    corners = [turn(v) for v in np.concatenate([plain.vertices, poster().vertices]).tolist()]
    lines = [f"mtllib {path.stem}.mtl"] + [f"v {x} {y} {z}" for x, y, z in corners]
    lines += [f"vt {u} {v}" for u, v in poster().visual.uv]
    lines += ["usemtl paint"] + [f"f {a} {b} {c}" for a, b, c in plain.faces + 1]
    first = len(plain.vertices)
    lines += ["usemtl poster"] + ["f " + " ".join(f"{first + i}/{i}" for i in face) for face in poster().faces + 1]
    path.write_text("\n".join(lines) + "\n")
    kd = " ".join(map(str, colour))
    path.with_suffix(".mtl").write_text(f"newmtl paint\nKd {kd}\nnewmtl poster\nKd 0.4 0.4 0.4\nmap_Kd {texture}\n")
    picture().save(path.parent / "picture.jpg", quality=95)
    return path


def write_quad_ply(path, *, object_ids: bool = False):
    """A room of 6 x 4 x 2.5 m as Replica lays it out: binary quads with normals and a colour per vertex.

    The floor is red, the ceiling blue; the walls blend from one to the other. Walls and floor are cut into squares of
    half a metre, as a scan would be.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    vertices: list[tuple[float, ...]] = []
    faces: list[tuple[int, ...]] = []
    size = (6.0, 4.0, 2.5)
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        for side in (0.0, size[axis]):
            cells = int(size[a] * 2), int(size[b] * 2)
            first = len(vertices)
            for i in range(cells[0] + 1):
                for j in range(cells[1] + 1):
                    corner = [0.0, 0.0, 0.0]
                    corner[axis], corner[a], corner[b] = side, i / 2, j / 2
                    vertices.append(tuple(corner))
            for i in range(cells[0]):
                for j in range(cells[1]):
                    at = first + i * (cells[1] + 1) + j
                    faces.append((at, at + cells[1] + 1, at + cells[1] + 2, at + 1))
    place = np.array(vertices)
    share = place[:, 2:] / 2.5
    rgb = np.round((1 - share) * RED + share * BLUE).astype(np.uint8)
    kinds = [(axis, "<f4") for axis in ("x", "y", "z", "nx", "ny", "nz")] + [(c, "u1") for c in "rgb"]
    rows = np.zeros(len(place), dtype=kinds)
    for i, axis in enumerate("xyz"):
        rows[axis], rows["rgb"[i]] = place[:, i], rgb[:, i]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(place)}"]
    head += [f"property float {axis}" for axis in ("x", "y", "z", "nx", "ny", "nz")]
    head += [f"property uchar {colour}" for colour in ("red", "green", "blue")]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    head += ["property int object_id"] * object_ids + ["end_header"]
    quads = np.zeros(len(faces), dtype=[("n", "u1"), ("v", "<i4", 4)] + [("id", "<i4")] * object_ids)
    quads["n"], quads["v"] = 4, faces
    path.write_bytes("\n".join(head).encode() + b"\n" + rows.tobytes() + quads.tobytes())
    return path
