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


def shelf_hall() -> trimesh.Trimesh:
    """A hall of 16 x 12 m, 5 m high, with two rows of shelves of 2.2 m, walls of desks of 1.7 m, and a post."""
    shelves = []
    for x, y in ((2.0, 3.0), (9.5, 3.0), (2.0, 6.0), (9.5, 6.0)):
        posts = [
            box((x + dx, y + dy, 0.0), (x + dx + 0.06, y + dy + 0.06, 2.2)) for dx in (0, 4.44) for dy in (0, 0.94)
        ]
        boards = [box((x, y, z), (x + 4.5, y + 1.0, z + 0.03)) for z in (0.2, 1.0, 1.7, 2.17)]
        goods = [
            box((x + dx, y + 0.1, z), (x + dx + 1.0, y + 0.9, z + 0.45)) for dx in (0.3, 2.5) for z in (1.03, 1.73)
        ]
        shelves += [*posts, *boards, *goods]
    desks = [box((x, 9.0, 0.0), (x + 0.05, 12.0, 1.7)) for x in (3.0, 6.0, 9.0)]
    fronts = [box((x, 9.0, 0.0), (x + 2.0, 9.05, 1.7)) for x in (0.0, 3.0, 6.0)]
    return trimesh.util.concatenate(
        [room(16.0, 12.0, 5.0), *shelves, *desks, *fronts, box((8.0, 1.5, 0.0), (8.3, 1.8, 5.0))]
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
