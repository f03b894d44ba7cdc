"""Pictures that tests of the map among people leave in ``build/people``: what is seen, and the map."""

from pathlib import Path

import numpy as np
from PIL import Image

from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.types import FREE, OCCUPIED

FOLDER = Path(__file__).parents[2] / "build/people"


def map_slice(grid: DepthOccupancy, middle_m: np.ndarray, height_m: float) -> np.ndarray:
    """Two metres of the map at a height: black is occupied, white free, grey unknown."""
    offset = np.linspace(-1.0, 1.0, 128)
    x, y = np.meshgrid(middle_m[0] + offset, middle_m[1] - offset)
    state = grid.state_at(np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height_m)])).reshape(x.shape)
    grey = np.select([state == OCCUPIED, state == FREE], [0, 255], 160).astype(np.uint8)
    return np.repeat(grey[:, :, None], 3, axis=2)


def save_picture(name: str, columns: list[np.ndarray]) -> None:
    """Write columns, side by side, three times as large."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    picture = Image.fromarray(np.hstack(columns))
    picture.resize((3 * picture.width, 3 * picture.height), Image.Resampling.NEAREST).save(FOLDER / f"{name}.png")
