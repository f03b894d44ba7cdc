"""GainCache of places as they were last worked out, one for each square of the plane."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int


class GainCache:
    """Remembers a panorama per square; squares are anchored in the world."""

    def __init__(self, side_m: float, num_azimuths: int) -> None:
        """Start with nothing remembered.

        Args:
            side_m: edge of the squares [m].
            num_azimuths: sectors of a panorama.
        """
        self._side_m = side_m
        self._key = np.zeros(0, np.int64)
        self._square = np.zeros((0, 2), np.int64)
        self._panorama = np.zeros((0, num_azimuths))

    def recall(
        self, places_xy_m: Float[np.ndarray, "n 2"]
    ) -> tuple[Float[np.ndarray, "n azimuths"], Bool[np.ndarray, " n"]]:
        """What is remembered of the squares that places lie in, and of which anything is."""
        key = _key(self._squares(places_xy_m))
        row = np.searchsorted(self._key, key)
        known = row < len(self._key)
        known[known] = self._key[row[known]] == key[known]
        panoramas = np.zeros((len(key), self._panorama.shape[1]))
        panoramas[known] = self._panorama[row[known]]
        return panoramas, known

    def remember(self, places_xy_m: Float[np.ndarray, "n 2"], panoramas: Float[np.ndarray, "n azimuths"]) -> None:
        """Take panoramas in; of two in one square the later counts."""
        square = np.concatenate([self._squares(places_xy_m)[::-1], self._square])
        self._key, first = np.unique(_key(square), return_index=True)
        self._square = square[first]
        self._panorama = np.concatenate([panoramas[::-1], self._panorama])[first]

    def forget(self, low_xy_m: Float[np.ndarray, 2], high_xy_m: Float[np.ndarray, 2]) -> None:
        """Forget all squares that touch the part between two corners [m]."""
        low, high = self._square * self._side_m, (self._square + 1) * self._side_m
        kept = (high < low_xy_m).any(axis=1) | (low > high_xy_m).any(axis=1)
        self._key, self._square, self._panorama = self._key[kept], self._square[kept], self._panorama[kept]

    def _squares(self, xy_m: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, "n 2"]:
        return np.floor(xy_m / self._side_m).astype(np.int64)


def _key(square: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
    """One number for each square."""
    return (square[:, 0] << 32) + square[:, 1]
