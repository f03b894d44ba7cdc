"""Arrays that grow: larger ones around a smaller one, and masks with their neighbours."""

import numpy as np
from jaxtyping import Bool, Int, Shaped


def embed(
    array: Shaped[np.ndarray, "..."], shape: tuple[int, ...], start: Int[np.ndarray, " axes"], fill: float | np.generic
) -> Shaped[np.ndarray, "..."]:
    """A larger array that contains a smaller, perhaps empty one from the index ``start`` on; ``fill`` elsewhere."""
    # np.pad does the same and takes several times as long.
    larger = np.full(shape, fill, array.dtype)
    larger[tuple(slice(int(a), int(a) + n) for a, n in zip(start, array.shape, strict=True))] = array
    return larger


def dilate_mask(mask: Bool[np.ndarray, "*cells"], first_axis: int = 0) -> Bool[np.ndarray, "*cells"]:
    """A mask and its face neighbours along all axes from the first one on."""
    near = mask.copy()
    for axis in range(first_axis, mask.ndim):
        ahead, behind = ((slice(None),) * axis + (part,) for part in (slice(1, None), slice(None, -1)))
        near[ahead] |= mask[behind]
        near[behind] |= mask[ahead]
    return near
