"""Small rooms with known measures, z up, for the tests of the scene stage."""

import numpy as np
import trimesh


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def room(x: float = 6.0, y: float = 4.0, z: float = 2.5, *, ceiling: bool = True) -> trimesh.Trimesh:
    """A room of walls 0.1 m thick on a slab 0.1 m thick whose top is at z = 0; its corner is at the origin."""
    pieces = [
        box((-0.1, -0.1, -0.1), (x + 0.1, y + 0.1, 0.0)),
        box((-0.1, -0.1, 0.0), (0.0, y + 0.1, z)),
        box((x, -0.1, 0.0), (x + 0.1, y + 0.1, z)),
        box((0.0, -0.1, 0.0), (x, 0.0, z)),
        box((0.0, y, 0.0), (x, y + 0.1, z)),
    ]
    if ceiling:
        pieces.append(box((-0.1, -0.1, z), (x + 0.1, y + 0.1, z + 0.1)))
    return trimesh.util.concatenate(pieces)


def two_rooms(door_width: float = 0.9) -> trimesh.Trimesh:
    """The room, divided at x = 3 by a wall 0.1 m thick with a doorway about y = 2, 2.05 m high."""
    low, high = 2.0 - door_width / 2, 2.0 + door_width / 2
    return trimesh.util.concatenate(
        [
            room(),
            box((2.95, 0.0, 0.0), (3.05, low, 2.5)),
            box((2.95, high, 0.0), (3.05, 4.0, 2.5)),
            box((2.95, low, 2.05), (3.05, high, 2.5)),
        ]
    )


def table(x: float, y: float, leg: float = 0.04) -> trimesh.Trimesh:
    """A table top of 1.2 x 0.8 m at 0.75 m on four legs, the corner of one at (x, y)."""
    legs = [box((x + dx, y + dy, 0.0), (x + dx + leg, y + dy + leg, 0.72)) for dx in (0.0, 1.16) for dy in (0.0, 0.76)]
    return trimesh.util.concatenate([*legs, box((x, y, 0.72), (x + 1.2, y + 0.8, 0.75))])


def to_y_up(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The same mesh as glTF prescribes: (x, y, z) becomes (x, z, -y)."""
    turned = mesh.copy()
    turned.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    return turned
