"""Types of the compiled engine, whose source is native/module.cpp; arrays are C-contiguous."""

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float32]
_Losses = tuple[float, float, float, float, float, float]

class Settings:
    levels: int
    log2_table_size: int
    bins: int
    hidden: int
    geometry: int
    bins_per_m: tuple[float, ...]
    truncation: float
    guided: bool
    free_samples: int
    near_samples: int
    max_depth: float
    none_step: float
    weight_rgb: float
    weight_depth: float
    weight_sdf: float
    weight_free: float
    weight_smoothness: float
    smoothness_points: int
    smoothness_spacing: float
    no_depth_rgb: float
    no_depth_is_free: bool
    table_rate: float
    decoder_rate: float
    beta1: float
    beta2: float
    epsilon: float
    decoder_decay: float

class Engine:
    def __init__(
        self,
        settings: Settings,
        cells_per_m: _Floats,
        factors: NDArray[np.int64],
        masks: NDArray[np.int64],
        linspace_free: _Floats,
        linspace_band: _Floats,
        linspace_spare: _Floats,
        num_threads: int,
        kernel: str,
    ) -> None: ...
    @property
    def kernel(self) -> str: ...
    @property
    def num_threads(self) -> int: ...
    def set_state(self, table: _Floats, decoders: _Floats) -> None: ...
    def get_state(self) -> tuple[_Floats, _Floats]: ...
    def step(
        self, origin: _Floats, direction: _Floats, rgb: _Floats, depth: _Floats, seed: int, corner: _Floats | None
    ) -> _Losses: ...
    def gradients(
        self, origin: _Floats, direction: _Floats, rgb: _Floats, depth: _Floats, depths: _Floats, corner: _Floats | None
    ) -> tuple[_Losses, _Floats, _Floats]: ...
    def sample(self, depth: _Floats, seed: int) -> _Floats: ...
    def query_sdf(self, points: _Floats) -> _Floats: ...
    def query_rgb(self, points: _Floats) -> _Floats: ...
    def query_perturbed(self, points: _Floats, decoders: _Floats) -> tuple[_Floats, _Floats]: ...
    def query_hidden(self, points: _Floats) -> _Floats: ...
    def query_sensitivity(self, points: _Floats) -> tuple[_Floats, _Floats]: ...
    def render(self, origin: _Floats, direction: _Floats, depths: _Floats) -> tuple[_Floats, _Floats]: ...

def kernel_names() -> list[str]: ...
def roofline(table_bytes: int, kernel: str) -> dict[str, float]: ...
