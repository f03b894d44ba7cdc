"""How noisy a depth camera is, learnt from its images.

Over a plane, inverse depth is linear in the pixel, so the second difference of three neighbours is noise and nothing
else: with independent errors of standard deviation s it has a variance of 6 s^2. Rooms are mostly planes, so the median
over an image tells s, whatever edges and plants do. Errors of stereo and of time-of-flight cameras grow with the square
of the depth, so s is one figure for all depths: sigma_z = s z^2. It holds what makes a pixel's depth uncertain by
itself (disparity, its quantization, its place in the image), not what all pixels share.
"""

import math

import numpy as np
from jaxtyping import Float32, Float64

from anm_mj.sensing.pixel_state import is_measured

EXACT_PER_M = 1e-5
"""Less noise than this is none: it is a tenth of a millimetre at 3 m, and rounding makes some [1/m]."""
_LINES = 64
"""So many rows and columns are looked at: the median of some thousand values is good to a few percent."""
_FIRST_IMAGES, _IMAGE_EVERY = 8, 8
"""The first images are all looked at, then one of so many: a sensor does not change."""
_TILES, _ROUGH_SHARE, _MOST_ROUGH = 4, 0.8, 3.0
"""An image is cut into so many by so many tiles; so large a share of them is no noisier than what counts as rough."""
_MEDIAN_OF_NORMAL = 0.6744897501960817
"""Median of the size of a standard normal variable."""
_LEAST_TRIPLES = 16
"""Fewer triples of measured pixels tell nothing."""


def inverse_depth_noise(depth_m: Float32[np.ndarray, "h w"]) -> float | None:
    """Standard deviation of inverse depth in an image [1/m], so that sigma_z = this times z^2. Planar depth that is not
    finite and positive was not measured. Returns the larger of the figures along rows and along columns; None where too
    little was measured to tell.
    """
    found = [noise for image in (depth_m, depth_m.T) if (noise := _noise_along_columns(image)) is not None]
    return max(found, default=None)


def rough_noise(depth_m: Float32[np.ndarray, "h w"]) -> float | None:
    """The same where the image is noisier than elsewhere: on floors and walls at grazing incidence, where a pixel's
    place in the image errs, too. The figure that so many tiles of the image do not exceed (``_ROUGH_SHARE``).
    """
    found = []
    for image in (depth_m, depth_m.T):
        bands = np.array_split(image, _TILES)
        tiles = [tile for band in bands for tile in np.array_split(band, _TILES, axis=1)]
        noises = [noise for tile in tiles if (noise := _noise_along_columns(tile)) is not None]
        if noises:
            found.append(float(np.quantile(noises, _ROUGH_SHARE)))
    return max(found, default=None)


def _noise_along_columns(depth_m: Float32[np.ndarray, "h w"]) -> float | None:
    rows, cols = (max(1, side // _LINES) for side in depth_m.shape)
    count = max((depth_m.shape[0] + rows - 3) // rows, 0)
    above, middle, below = (depth_m[start::rows, ::cols][:count] for start in range(3))
    measured = is_measured(above) & is_measured(middle) & is_measured(below)
    if np.count_nonzero(measured) < _LEAST_TRIPLES:
        return None
    above, middle, below = (1.0 / depth[measured].astype(np.float64) for depth in (above, middle, below))
    return float(np.median(np.abs(above - 2.0 * middle + below))) / (_MEDIAN_OF_NORMAL * math.sqrt(6.0))


class NoiseMean:
    """The means of :func:`inverse_depth_noise` and :func:`rough_noise` over the images of a sensor."""

    def __init__(self) -> None:
        self._sum = self._rough_sum = 0.0
        self._count = 0
        self._num_images = 0

    @property
    def value(self) -> float:
        """The mean [1/m]; infinite before the first image that tells."""
        return self._sum / self._count if self._count else math.inf

    @property
    def rough(self) -> float:
        """The mean where images are noisier than elsewhere [1/m]; clutter looks like noise, so at most so many times
        the other one (``_MOST_ROUGH``).
        """
        return min(self._rough_sum / self._count, _MOST_ROUGH * self.value) if self._count else math.inf

    def add(self, depth_m: Float32[np.ndarray, "h w"]) -> None:
        """Take in one image of planar depth [m]; of later ones only some are looked at."""
        self._num_images += 1
        if self._count >= _FIRST_IMAGES and self._num_images % _IMAGE_EVERY:
            return
        noise = inverse_depth_noise(depth_m)
        if noise is not None:
            self._sum += noise
            self._rough_sum += max(rough_noise(depth_m) or 0.0, noise)
            self._count += 1

    def array(self) -> Float64[np.ndarray, "4"]:
        """Sum and number of the figures, number of images, and sum of the rough figures."""
        return np.array([self._sum, self._count, self._num_images, self._rough_sum], np.float64)

    def set_array(self, array: Float64[np.ndarray, "n"]) -> None:
        """Take over what :meth:`array` gave; maps of earlier versions lack the last figure."""
        self._sum, self._count, self._num_images = float(array[0]), int(array[1]), int(array[2])
        self._rough_sum = float(array[3]) if len(array) > 3 else self._sum
