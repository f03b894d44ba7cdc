"""Types of the compiled engine, whose source is native/; arrays are C-contiguous."""

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
    def set_optimizer(
        self,
        table_m: _Floats,
        table_v: _Floats,
        touched: NDArray[np.uint8],
        decoders_m: _Floats,
        decoders_v: _Floats,
        iteration: int,
    ) -> None: ...
    def get_optimizer(self) -> tuple[_Floats, _Floats, NDArray[np.uint8], _Floats, _Floats, int]: ...
    def step(
        self, origin: _Floats, direction: _Floats, rgb: _Floats, depth: _Floats, seed: int, corner: _Floats | None
    ) -> _Losses: ...
    def steps(
        self,
        batches: list[tuple[_Floats, _Floats, _Floats, _Floats]],
        seeds: list[int],
        corners: list[_Floats | None],
    ) -> list[_Losses]: ...
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
    def align(
        self,
        points: _Floats,
        rgb: _Floats,
        variance: _Floats,
        trust: _Floats,
        rotation: _Floats,
        position: _Floats,
        slopes: tuple[float, float, float],
        field_variance: float,
        kernel: float,
        color_deviation: float,
        color_kernel: float,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]: ...

class Occupancy:
    def __init__(self, num_threads: int, kernel: str) -> None: ...
    def bind(
        self,
        log_odds: NDArray[np.int8],
        state: NDArray[np.int8],
        seen_range: _Floats,
        num_hits: NDArray[np.uint16],
        block_stamp: NDArray[np.int32],
        column_version: NDArray[np.int32],
        corner: NDArray[np.int64],
    ) -> None: ...
    def carve(
        self,
        depth: _Floats,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        rotation: _Floats,
        position: _Floats,
        low: NDArray[np.int64],
        high: NDArray[np.int64],
        edge: float,
        margin: float,
        footprint_px: float,
        nearest: float,
        furthest: float,
        miss: int,
        limit: int,
        no_depth_is_free: bool,
        frame: int,
        heavy: NDArray[np.uint8],
        heavy_miss: int,
    ) -> None: ...
    def mark(
        self, voxels: NDArray[np.int64], depth: _Floats, range_step: float, hit: int, limit: int, frame: int
    ) -> None: ...
    def hits(
        self,
        depth: _Floats,
        rays: _Floats,
        first_row: int,
        first_col: int,
        stride: int,
        range: float,
        matrix: _Floats,
        offset: _Floats,
        voxels: NDArray[np.int64],
        hit_depth: _Floats,
    ) -> int: ...
    def counts(
        self,
        depth: _Floats,
        rays: _Floats,
        range: float,
        matrix: _Floats,
        offset: _Floats,
        out: NDArray[np.uint16],
    ) -> None: ...
    def free_left(self, heavy: NDArray[np.uint8], low: int, high: int, miss: int, frame: int) -> int: ...
    def moved(
        self,
        depth: _Floats,
        rays: _Floats,
        matrix: _Floats,
        offset: _Floats,
        edge: float,
        noise: float,
        doubt: float,
        turn: float,
        range: float,
        free: int,
        known: int,
        support: int,
        reach_m: float,
        focal_px: float,
        apart_m: float,
        apart_share: float,
        out: NDArray[np.uint8],
    ) -> int: ...

def voxels_to_read(state: NDArray[np.int8], blocks: NDArray[np.int64], out: NDArray[np.int64]) -> int: ...
def voxels_in_doubt(
    state: NDArray[np.int8], agreed: NDArray[np.int8], blocks: NDArray[np.int64], out: NDArray[np.int64]
) -> int: ...
def write_blocks(
    state: NDArray[np.int8],
    blocks: NDArray[np.int64],
    voxels: NDArray[np.int64],
    read: NDArray[np.int8],
    out: NDArray[np.int8],
    moved: NDArray[np.uint8],
) -> None: ...

_KeyImage = tuple[NDArray[np.uint16], NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64], int]

def frame_to_frames(
    points: _Floats,
    gray: _Floats,
    variance: _Floats,
    trust: _Floats,
    images: list[_KeyImage],
    T: NDArray[np.float64],
    depth_share: float,
    settings: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]: ...
def shares_in(
    points: _Floats,
    images: list[_KeyImage],
    T: NDArray[np.float64],
    nearness: float,
    slack_m: float,
    most_scale: float,
) -> list[float]: ...
def near_occupied(
    state: NDArray[np.int8],
    corner: NDArray[np.int64],
    voxel_m: float,
    points: NDArray[np.float64],
    reach: float,
    out: NDArray[np.uint8],
) -> None: ...
def agreement(
    state: NDArray[np.int8],
    log_odds: NDArray[np.int8],
    corner: NDArray[np.int64],
    voxel_m: float,
    points: NDArray[np.float64],
    origin: NDArray[np.float64],
    reach: float,
    shares: NDArray[np.float64],
    margin: float,
    out: NDArray[np.uint8],
) -> None: ...
def smoothed_depth(depth: _Floats, radius: int, noise: float, spread_share: float) -> _Floats: ...
def ray_batches(
    pixels: NDArray[np.uint8],
    cameras: _Floats,
    place: NDArray[np.int64],
    keyframe: NDArray[np.int64],
    depth_unit: float,
    origin: _Floats,
    direction: _Floats,
    rgb: _Floats,
    depth: _Floats,
) -> tuple[_Floats, _Floats, _Floats, _Floats]: ...
def voxel_centres(
    voxels: NDArray[np.int64], shape: NDArray[np.int64], corner: NDArray[np.int64], resolution: float
) -> _Floats: ...
def decide_voxels(
    state: NDArray[np.int8],
    seen: _Floats,
    voxels: NDArray[np.int64],
    sdf: _Floats,
    rule: _Floats,
    out: NDArray[np.int8],
) -> None: ...
def touched_cells(
    state: NDArray[np.int8], blocks: NDArray[np.int64], low: NDArray[np.int64], high: NDArray[np.int64]
) -> tuple[NDArray[np.uint8], tuple[int, int, int]] | None: ...
def lattice_corners(
    cells: NDArray[np.uint8], corner: NDArray[np.int64], spacing: float, corners: NDArray[np.uint8]
) -> _Floats: ...
def lattice_crossings(
    corners: NDArray[np.uint8], values: _Floats, corner: NDArray[np.int64], spacing: float
) -> NDArray[np.float64]: ...
def pass_variance(sdf: _Floats, rgb: _Floats, color_weight: float) -> _Floats: ...
def triangle_distances(
    corners: NDArray[np.float64], points: NDArray[np.float64], out: NDArray[np.float64], threads: int
) -> None: ...
def lower_distances(
    points: NDArray[np.float64], places: NDArray[np.float64], distance: NDArray[np.float64], num_threads: int
) -> None: ...
def pool_window(
    state: NDArray[np.int8],
    low: NDArray[np.int64],
    shape: NDArray[np.int64],
    floor: int,
    out: NDArray[np.int8],
    to: NDArray[np.int64],
    num_free: NDArray[np.int64],
    num_surface: NDArray[np.int64],
) -> tuple[int, int, int, int] | None: ...
def cast_rays(
    cells: NDArray[np.int8],
    offset: NDArray[np.int64],
    start: NDArray[np.int64],
    rows: NDArray[np.int32],
    hit: NDArray[np.int32],
    state: NDArray[np.int8],
    sample: NDArray[np.uint8],
    depth: NDArray[np.uint8],
) -> None: ...
def ray_gains(
    hit: NDArray[np.int32],
    state: NDArray[np.int8],
    sample: NDArray[np.uint8],
    depth: NDArray[np.uint8],
    distance: _Floats,
    layer_share: _Floats,
    tried: _Floats,
    rule: _Floats,
    gain: _Floats,
) -> None: ...
def first_closed(
    cells: NDArray[np.int8],
    frame: NDArray[np.float64],
    start: NDArray[np.float64],
    direction: NDArray[np.float64],
    distance: NDArray[np.float64],
    cell: NDArray[np.int64],
    sample: NDArray[np.int64],
) -> None: ...
def capped_distances(free: NDArray[np.uint8], cap: int) -> _Floats: ...
def small_components(mask: NDArray[np.uint8], most: float, out: NDArray[np.uint8]) -> None: ...
def connected_components(links: NDArray[np.int64], component: NDArray[np.int64]) -> None: ...
def tour_coverage(
    stops: NDArray[np.int64],
    start: NDArray[np.int64],
    budget: int,
    turns: NDArray[np.int32],
    paths: NDArray[np.int32],
    yaws: NDArray[np.int8],
    steps: NDArray[np.int64],
    covers: NDArray[np.uint64],
    seen: NDArray[np.uint64],
    numbers: NDArray[np.int64],
    covered: NDArray[np.int64],
    wanted: NDArray[np.int64],
) -> tuple[int, int]: ...
def roadmap_path(
    ends: NDArray[np.int64],
    before: NDArray[np.int32],
    places: NDArray[np.float64],
    clearance: NDArray[np.float64],
    nearest: NDArray[np.int32],
    frame: NDArray[np.float64],
    rule: NDArray[np.float64],
    bits: NDArray[np.uint64],
    cover: NDArray[np.uint64],
) -> tuple[int, int, int]: ...
def cover_samples(
    points: NDArray[np.float64],
    samples: NDArray[np.float64],
    level: NDArray[np.int32],
    column_start: NDArray[np.int64],
    low: NDArray[np.float64],
    cell: float,
    within: float,
    covered: NDArray[np.uint8],
    near: NDArray[np.uint8],
) -> int: ...
def depth_outliers(
    depth: NDArray[np.float32], support: int, share: float, least: float, out: NDArray[np.uint8]
) -> None: ...
def lend_cores(cores: int) -> None: ...
def kernel_names() -> list[str]: ...

# Limits of one core, measured in about a second of its time. "fma_gflops": multiply-adds on registers; "load_ns" and
# "update_ns": per random pair of floats of a table read and accumulated, or read, changed and written;
# "stream_gb_per_s": reading and writing 28 MiB in order.
def roofline(table_bytes: int, kernel: str) -> dict[str, float]: ...
