"""How noisy a depth camera is, learnt from its images, and whether single pixels of it stray.

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
_MEDIAN_OF_NORMAL = 0.6744897501960817
"""Median of the size of a standard normal variable."""
_LEAST_TRIPLES = 16
"""Fewer triples of measured pixels tell nothing."""
_USUAL_FRAMES, _USUAL_SHARE = 3.0, 0.03
"""So many images, and this share of all, hold a pixel alone in space that is surely free although the depth is exact:
none in three scenes, 2.5 % at most by poses that drift, and 8 to 40 % if one pixel in 3000 is speckle, or one in ten at
edges flies."""


def inverse_depth_noise(depth_m: Float32[np.ndarray, "h w"]) -> float | None:
    """Standard deviation of inverse depth in an image [1/m], so that sigma_z = this times z^2. Planar depth that is not
    finite and positive was not measured. Returns the larger of the figures along rows and along columns; None where too
    little was measured to tell.
    """
    found = [noise for image in (depth_m, depth_m.T) if (noise := _noise_along_columns(image)) is not None]
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
    """The mean of :func:`inverse_depth_noise` over the images of a sensor."""

    def __init__(self) -> None:
        self._sum = 0.0
        self._count = 0
        self._num_images = 0

    @property
    def value(self) -> float:
        """The mean [1/m]; infinite before the first image that tells."""
        return self._sum / self._count if self._count else math.inf

    def add(self, depth_m: Float32[np.ndarray, "h w"]) -> None:
        """Take in one image of planar depth [m]; of later ones only some are looked at."""
        self._num_images += 1
        if self._count >= _FIRST_IMAGES and self._num_images % _IMAGE_EVERY:
            return
        noise = inverse_depth_noise(depth_m)
        if noise is not None:
            self._sum += noise
            self._count += 1

    def array(self) -> Float64[np.ndarray, "3"]:
        """Sum and number of the figures, and number of images."""
        return np.array([self._sum, self._count, self._num_images], np.float64)

    def set_array(self, array: Float64[np.ndarray, "3"]) -> None:
        """Take over what :meth:`array` gave."""
        self._sum, self._count, self._num_images = float(array[0]), int(array[1]), int(array[2])


class Strays:
    """Whether a sensor's images hold pixels that lie where nothing is: speckle, or edges that fly.

    Such a pixel is off by any amount, which no standard deviation tells. It shows where space is known to be free, and
    by lying there alone: a wrong pose puts whole surfaces there.
    """

    def __init__(self) -> None:
        self._num_images = 0
        self._num_straying = 0

    @property
    def are_known(self) -> bool:
        """Whether more images hold such pixels than those of an exact sensor do."""
        return self._num_straying > _USUAL_FRAMES + _USUAL_SHARE * self._num_images

    def add(self, strays: bool) -> None:
        """Take in one image, by whether a pixel of it lies alone in space that was surely free before."""
        self._num_images += 1
        self._num_straying += strays

    def array(self) -> Float64[np.ndarray, "2"]:
        """Numbers of images, and of those with such pixels."""
        return np.array([self._num_images, self._num_straying], np.float64)

    def set_array(self, array: Float64[np.ndarray, "2"]) -> None:
        """Take over what :meth:`array` gave."""
        self._num_images, self._num_straying = int(array[0]), int(array[1])
