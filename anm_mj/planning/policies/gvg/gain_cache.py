"""Expected gain per azimuth sector as last computed, one entry for each square of the plane."""

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.planning.policies.gvg.views import NUM_AZIMUTHS


class GainCache:
    """Remembers gains by square; the squares have fixed places in the world."""

    def __init__(self, side_m: float) -> None:
        """Start empty, with squares of this side [m]."""
        self._side_m = side_m
        self._key = np.zeros(0, np.int64)
        self._square = np.zeros((0, 2), np.int64)
        self._gain_m2 = np.zeros((0, NUM_AZIMUTHS))

    def lookup(
        self, places_xy_m: Float[np.ndarray, "n 2"]
    ) -> tuple[Float[np.ndarray, "n azimuths"], Bool[np.ndarray, " n"]]:
        """The gains of the squares that contain places [m2], zero for none, and which squares have an entry."""
        key = _key(self._squares(places_xy_m))
        row = np.searchsorted(self._key, key)
        known = row < len(self._key)
        known[known] = self._key[row[known]] == key[known]
        gain_m2 = np.zeros((len(key), NUM_AZIMUTHS))
        gain_m2[known] = self._gain_m2[row[known]]
        return gain_m2, known

    def store(self, places_xy_m: Float[np.ndarray, "n 2"], gain_m2: Float[np.ndarray, "n azimuths"]) -> None:
        """Remember gains [m2]; the last one for a square counts."""
        square = np.concatenate([self._squares(places_xy_m)[::-1], self._square])
        self._key, first = np.unique(_key(square), return_index=True)
        self._square = square[first]
        self._gain_m2 = np.concatenate([gain_m2[::-1], self._gain_m2])[first]

    def invalidate(self, low_xy_m: Float[np.ndarray, "2"], high_xy_m: Float[np.ndarray, "2"]) -> None:
        """Forget all squares that touch the box between two corners [m]."""
        low, high = self._square * self._side_m, (self._square + 1) * self._side_m
        kept = (high < low_xy_m).any(axis=1) | (low > high_xy_m).any(axis=1)
        self._key, self._square, self._gain_m2 = self._key[kept], self._square[kept], self._gain_m2[kept]

    def _squares(self, xy_m: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, "n 2"]:
        return np.floor(xy_m / self._side_m).astype(np.int64)


def _key(square: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
    return (square[:, 0] << 32) + square[:, 1]
