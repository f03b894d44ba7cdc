"""What the engines that compute with torch tensors share: numpy at the border, and queries in chunks."""

from collections.abc import Callable, Iterator

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from anm_mj.errors import MapError
from anm_mj.mapping.backends.adam import Adam
from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.mapping_config import MappingConfig

CPU_CHUNK = 8192
"""Points per query on a CPU: the temporaries of so many stay in the second-level cache's reach."""
CUDA_CHUNK = 1 << 18
"""Points per query on a GPU."""


def resolve_device(device: str) -> torch.device:
    """The torch device for "auto", "cpu" or "cuda". Raises MapError if CUDA is asked for and not there."""
    if device == "cuda" and not torch.cuda.is_available():
        raise MapError("The mapping device is 'cuda', but torch finds no CUDA device; use 'auto' or 'cpu'.")
    use_cuda = device == "cuda" or (device == "auto" and torch.cuda.is_available())
    return torch.device("cuda" if use_cuda else "cpu")


class TensorBackend(MapperBackend):
    """Base of engines that compute with torch tensors on one device."""

    _optimizer: Adam

    def __init__(self, config: MappingConfig, device: str, chunk: int | None = None) -> None:
        """Choose the device. ``device`` is "auto", "cpu" or "cuda"; ``chunk`` are points per query, None = what suits
        the device. Raises MapError if the device is unknown or absent.
        """
        self.config = config
        self._device = resolve_device(device)
        self.device = self._device.type
        self._chunk = chunk or (CUDA_CHUNK if self.device == "cuda" else CPU_CHUNK)

    def _tensor(self, array: Float[np.ndarray, "..."]) -> Float[Tensor, "..."]:
        return torch.from_numpy(np.ascontiguousarray(array, np.float32)).to(self._device)

    def _chunks(self, points_m: Float[np.ndarray, "n 3"]) -> Iterator[tuple[slice, Float[Tensor, "m 3"]]]:
        """Points in pieces, each with its rows."""
        for start in range(0, len(points_m), self._chunk):
            rows = slice(start, start + self._chunk)
            yield rows, self._tensor(points_m[rows])

    def _ask(
        self, points_m: Float[np.ndarray, "n 3"], answer: Callable[[Tensor], Tensor], *width: int
    ) -> Float32[np.ndarray, "n ..."]:
        """What ``answer`` says about each point, in arrays of shape ``width``; asked chunk by chunk."""
        out = np.empty((len(points_m), *width), np.float32)
        for rows, points in self._chunks(points_m):
            out[rows] = answer(points).cpu().numpy()
        return out

    def get_state(self) -> dict[str, np.ndarray]:
        """Parameters, and Adam's moments and steps; see the base class."""
        return {**self.parameters(), **self._optimizer.get_state()}

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Take over what :meth:`get_state` gave; see the base class."""
        self.set_parameters(state)
        self._optimizer.set_state(state)
