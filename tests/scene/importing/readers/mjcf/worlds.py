"""Small MuJoCo worlds for the tests of this folder."""

import numpy as np

EYES = [(0.0, 0.0, 1.25, k * np.pi / 4) for k in range(8)] + [(-3, -1, 1, 0), (3, 1, 1.8, 3), (2, -3, 0.6, 0)]


def write_world(path, body: str, more: str = ""):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"<mujoco>{more}<worldbody>{body}</worldbody></mujoco>")
    return path


def room_xml(half: float = 3.0, height: float = 2.5) -> str:
    floor = f'<geom name="floor" type="plane" size="{half} {half} 1"/>'
    walls = ((half, 0, 0.05, half), (-half, 0, 0.05, half), (0, half, half, 0.05), (0, -half, half, 0.05))
    return floor + "".join(
        f'<geom name="wall_{i}" type="box" pos="{x} {y} {height / 2}" size="{a} {b} {height / 2}"/>'
        for i, (x, y, a, b) in enumerate(walls)
    )


ROOM_WALLS = room_xml().partition("/>")[2]


def near(vertices, xy, radius):
    inside = np.abs(vertices[:, :2] - np.array(xy)).max(axis=1) < radius
    # The ceiling and the ground span everything, but have no corners inside.
    return inside & (vertices[:, 2] < 2.4)
