"""Settings of the mapping stage, one frozen dataclass per part, and the presets; free of torch, so quick to import."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, is_dataclass
from typing import Any, Literal

from anm_mj.errors import MapError

ENGINES = ("auto", "native", "triton", "torch", "mlp")
"""Names of the engines that compute the map, see :mod:`anm_mj.mapping.backends.select`."""


def _require(ok: bool, name: str, value: object, wanted: str) -> None:
    if not ok:
        raise MapError(f"{name} is {value!r}, but {wanted}.")


@dataclass(frozen=True)
class FieldConfig:
    """Shape of the neural field: a hash grid and a one-blob code in metric world coordinates, and two decoders."""

    num_levels: int = 16
    """Levels of the hash grid; each holds 2 features per entry."""
    log2_table_size: int = 16
    """Binary logarithm of the number of entries per level at the start."""
    largest_log2_table_size: int = 17
    """Up to this the table doubles as the scene grows; at or below ``log2_table_size`` it keeps its size."""
    entries_per_m3: float = 120.0
    """The table doubles when it has fewer entries per level than this for each cubic metre of the occupancy grid's
    blocks that hold surface (about 1 m3 to a square metre of surface) [1/m3]."""
    finest_cell_m: float = 0.01
    """Edge of a cell on the finest level [m]."""
    coarsest_cell_m: float = 0.6
    """Edge of a cell on the coarsest level [m]; the levels between grow geometrically."""
    torus_min_cell_m: float = 0.25
    """Levels with cells at least this large [m] index their entries by position modulo a box, free of collisions inside
    it (for 2^16 entries 64 x 64 x 16 cells, at least 16 x 16 x 4 m); finer levels are hashed."""
    blob_bins: int = 16
    """Bins of the one-blob code per axis."""
    blob_period_m: tuple[float, float, float] = (16.0, 16.0, 4.0)
    """Lengths along world x, y, z after which the one-blob code repeats [m]."""
    hidden_width: int = 32
    """Neurons in the one hidden layer of each decoder."""
    geometry_features: int = 15
    """Outputs of the SDF decoder beside s; they feed the colour decoder."""
    truncation_m: float = 0.1
    """Distance at which the SDF saturates [m]; the network's s is a fraction of it."""

    def __post_init__(self) -> None:
        _require(1 <= self.num_levels <= 32, "num_levels", self.num_levels, "a hash grid has 1 to 32 levels")
        _require(
            8 <= self.log2_table_size <= 22,
            "log2_table_size",
            self.log2_table_size,
            "tables of 2^8 to 2^22 entries are supported",
        )
        _require(
            self.largest_log2_table_size <= 22,
            "largest_log2_table_size",
            self.largest_log2_table_size,
            "tables of up to 2^22 entries are supported",
        )
        _require(self.entries_per_m3 > 0.0, "entries_per_m3", self.entries_per_m3, "it must be positive")
        _require(
            0.0 < self.finest_cell_m <= self.coarsest_cell_m,
            "finest_cell_m",
            self.finest_cell_m,
            f"it must be positive and at most coarsest_cell_m ({self.coarsest_cell_m})",
        )
        _require(self.blob_bins >= 4, "blob_bins", self.blob_bins, "the kernel spans 3 bins, so 4 or more are needed")
        _require(min(self.blob_period_m) > 0.0, "blob_period_m", self.blob_period_m, "periods must be positive")
        _require(self.hidden_width >= 1, "hidden_width", self.hidden_width, "at least 1 neuron is needed")
        _require(
            self.geometry_features >= 1, "geometry_features", self.geometry_features, "at least 1 feature is needed"
        )
        _require(self.truncation_m > 0.0, "truncation_m", self.truncation_m, "it must be positive")


@dataclass(frozen=True)
class SamplingConfig:
    """Where samples lie along a training ray."""

    scheme: Literal["guided", "uniform"] = "guided"
    """"guided": free samples end at the surface's band, none behind it. "uniform": free samples span [0, far_m]
    whatever the depth (the paper's own, after Co-SLAM)."""
    free_samples: int = 2
    """Samples per ray outside the band about the surface."""
    near_samples: int = 4
    """Samples per ray within the truncation distance of the measured depth."""
    far_m: float = 5.0
    """Planar depth up to which rays without a surface are sampled, and all rays of the uniform scheme [m]."""
    max_depth_m: float = 10.0
    """Depth beyond this counts as none [m]."""

    def __post_init__(self) -> None:
        _require(self.free_samples >= 1, "free_samples", self.free_samples, "at least 1 is needed")
        _require(self.near_samples >= 1, "near_samples", self.near_samples, "at least 1 is needed")
        _require(self.far_m > 0.0, "far_m", self.far_m, "it must be positive")
        _require(self.max_depth_m > 0.0, "max_depth_m", self.max_depth_m, "it must be positive")

    @property
    def samples_per_ray(self) -> int:
        """Number of samples on every ray."""
        return self.free_samples + self.near_samples


@dataclass(frozen=True)
class LossConfig:
    """Weights of the five loss terms (paper, section IV-B)."""

    rgb: float = 5.0
    """Weight of the colour term."""
    depth: float = 0.1
    """Weight of the rendered-depth term [1/m^2]."""
    sdf: float = 1000.0
    """Weight of the term on samples in the truncation band [1/m^2]."""
    free_space: float = 10.0
    """Weight of the term on samples in front of the band."""
    smoothness: float = 0.0
    """Weight of the feature smoothness term; 0 leaves its samples out."""
    smoothness_points: int = 31
    """Points along each edge of the random lattice that the smoothness term is taken on."""
    smoothness_spacing_m: float = 0.1
    """Distance between neighbours on that lattice [m]."""
    no_depth_rgb: float = 0.05
    """Factor on the colour residual of rays without depth."""
    no_depth_is_free: bool = True
    """Whether a pixel without depth says that nothing is there up to ``SamplingConfig.far_m``, as it does for sky in a
    simulator, or nothing at all, as with a scanner that loses dark or glossy surfaces."""

    def __post_init__(self) -> None:
        for name in ("rgb", "depth", "sdf", "free_space", "smoothness", "no_depth_rgb"):
            value = getattr(self, name)
            _require(value >= 0.0, name, value, "loss weights cannot be negative")
        _require(self.smoothness_points >= 2, "smoothness_points", self.smoothness_points, "at least 2 are needed")
        _require(
            self.smoothness_spacing_m > 0.0, "smoothness_spacing_m", self.smoothness_spacing_m, "it must be positive"
        )


@dataclass(frozen=True)
class OptimizerConfig:
    """Adam, with one learning rate for the table and one for the decoders."""

    table_learning_rate: float = 1e-2
    """Learning rate of the hash table."""
    decoder_learning_rate: float = 1e-2
    """Learning rate of both decoders."""
    beta1: float = 0.9
    """Decay of the first moment."""
    beta2: float = 0.99
    """Decay of the second moment."""
    epsilon: float = 1e-15
    """Added to the root of the second moment; tiny, so that entries seen once still learn."""
    decoder_weight_decay: float = 1e-6
    """L2 penalty on the decoders' weights."""

    def __post_init__(self) -> None:
        for name in ("table_learning_rate", "decoder_learning_rate", "epsilon"):
            value = getattr(self, name)
            _require(value > 0.0, name, value, "it must be positive")
        for name in ("beta1", "beta2"):
            value = getattr(self, name)
            _require(0.0 <= value < 1.0, name, value, "it must lie in [0, 1)")


@dataclass(frozen=True)
class ScheduleConfig:
    """How much is trained, when, and on what; counted in steps and iterations, never in seconds."""

    first_iterations: int = 200
    """Iterations on the first frame."""
    iterations: int = 5
    """Iterations on each training step."""
    train_every: int = 1
    """Train on each n-th frame."""
    num_rays: int = 512
    """Rays per iteration drawn from the keyframes."""
    min_current_rays: int = 26
    """Rays per iteration drawn from the frame at hand, beside the keyframes' own; more while keyframes are few."""
    keyframe_every: int = 5
    """Each n-th frame becomes a keyframe, the first one always."""
    pixel_share: float = 1.0
    """Share of a keyframe's pixels that is kept for replay, in (0, 1]."""
    evenness: float = 0.5
    """Pixels of a keyframe are kept in proportion to (looks at the place they show)^-evenness, in [0, 1]: with 0 each
    place is replayed as often as it was seen, with 1 all surface alike, however often it was seen."""
    replay_bytes: int = 256_000_000
    """Memory for keyframes [bytes]; when it is full, each keyframe gives up a random half of its pixels."""

    def __post_init__(self) -> None:
        for name in ("first_iterations", "iterations"):
            value = getattr(self, name)
            _require(value >= 0, name, value, "it cannot be negative")
        for name in ("train_every", "num_rays", "min_current_rays", "keyframe_every"):
            value = getattr(self, name)
            _require(value >= 1, name, value, "it must be at least 1")
        _require(0.0 < self.pixel_share <= 1.0, "pixel_share", self.pixel_share, "it must lie in (0, 1]")
        _require(0.0 <= self.evenness <= 1.0, "evenness", self.evenness, "it must lie in [0, 1]")
        _require(self.replay_bytes >= 1_000_000, "replay_bytes", self.replay_bytes, "at least 1 MB is needed")


@dataclass(frozen=True)
class OccupancyConfig:
    """The grid of free, occupied and unknown voxels fused from depth."""

    voxel_m: float = 0.05
    """Edge of a voxel [m]."""
    hit_range_m: float = 8.0
    """Planar depth up to which a pixel marks its voxel occupied [m]."""
    carve_range_m: float = 5.0
    """Planar depth up to which space in front of surfaces becomes free [m]."""
    hit: int = 10
    """Added to a voxel's log-odds for a frame with a surface in it (in tenths)."""
    miss: int = 2
    """Taken from a voxel's log-odds for a frame that looks through it (in tenths)."""
    limit: int = 60
    """Bound on the size of a voxel's log-odds (in tenths), so that it can change its mind."""
    no_depth_is_free: bool = True
    """Whether pixels without depth carve up to ``carve_range_m``."""

    def __post_init__(self) -> None:
        for name in ("voxel_m", "hit_range_m", "carve_range_m"):
            value = getattr(self, name)
            _require(value > 0.0, name, value, "it must be positive")
        _require(1 <= self.limit <= 127, "limit", self.limit, "log-odds are stored in 8 bits, so 1 to 127")
        _require(1 <= self.hit <= self.limit, "hit", self.hit, f"it must lie in [1, limit] = [1, {self.limit}]")
        _require(1 <= self.miss <= self.limit, "miss", self.miss, f"it must lie in [1, limit] = [1, {self.limit}]")


@dataclass(frozen=True)
class UncertaintyConfig:
    """How the uncertainty of the map at a point is computed."""

    method: Literal["evidence", "closed_form", "perturbation"] = "evidence"
    """"evidence": by how densely a place was looked at and how usual its features are; predicts the true error best of
    the three. "perturbation": sample variance over noisy decoders (paper, Eq. 4). "closed_form": the first-order limit
    of that for infinitely many passes, at the price of two; closer to it than 20 passes are."""
    noise_std: float = 0.02
    """Standard deviation b of the Gaussian noise on every decoder weight."""
    num_passes: int = 20
    """Number of noisy decoders."""
    color_weight: float = 1.0
    """Weight of the mean variance of the colour channels (in [0, 1]) against that of s (in truncations)."""

    def __post_init__(self) -> None:
        methods = ("evidence", "closed_form", "perturbation")
        _require(self.method in methods, "method", self.method, f"it must be one of {methods}")
        _require(self.noise_std > 0.0, "noise_std", self.noise_std, "it must be positive")
        _require(self.num_passes >= 2, "num_passes", self.num_passes, "a variance needs at least 2 passes")
        _require(self.color_weight >= 0.0, "color_weight", self.color_weight, "it cannot be negative")


@dataclass(frozen=True)
class MappingConfig:
    """Settings of the mapping stage."""

    field: FieldConfig = FieldConfig()
    sampling: SamplingConfig = SamplingConfig()
    loss: LossConfig = LossConfig()
    optimizer: OptimizerConfig = OptimizerConfig()
    schedule: ScheduleConfig = ScheduleConfig()
    occupancy: OccupancyConfig = OccupancyConfig()
    uncertainty: UncertaintyConfig = UncertaintyConfig()
    engine: Literal["auto", "native", "triton", "torch", "mlp"] = "auto"
    """What computes: "native" (C++ on the CPU), "triton" (CUDA; not measured yet), "torch" (any device), or "auto":
    native wherever it was built, else torch. These give the same map up to rounding. "mlp" is another map: one network
    without a grid (Yan et al., ICCV 2023), in torch."""
    surface_lattice_m: float = 0.1
    """Spacing of the lattice on which zero-crossings are looked for [m]."""

    def __post_init__(self) -> None:
        _require(self.engine in ENGINES, "engine", self.engine, f"it must be one of {ENGINES}")
        methods = (
            ("perturbation", "closed_form") if self.engine == "mlp" else ("evidence", "perturbation", "closed_form")
        )
        known = self.uncertainty.method in methods
        _require(known, "uncertainty.method", self.uncertainty.method, f"engine {self.engine} knows {methods}")
        _require(self.surface_lattice_m > 0.0, "surface_lattice_m", self.surface_lattice_m, "it must be positive")


def default_mapping() -> MappingConfig:
    """Many small batches of depth-guided rays, of which places with few looks get more than their share."""
    return MappingConfig()


def paper_mapping() -> MappingConfig:
    """The paper's own training effort and sampling (section IV-B, with the numbers of its released code)."""
    return MappingConfig(
        field=FieldConfig(largest_log2_table_size=16),
        sampling=SamplingConfig(scheme="uniform", free_samples=32, near_samples=11, far_m=4.0),
        loss=LossConfig(smoothness=1e-5, no_depth_is_free=False),
        optimizer=OptimizerConfig(table_learning_rate=1e-3),
        schedule=ScheduleConfig(
            iterations=10, train_every=5, num_rays=2048, min_current_rays=100, pixel_share=0.05, evenness=0.0
        ),
        uncertainty=UncertaintyConfig(method="perturbation"),
    )


def anm_mapping() -> MappingConfig:
    """One network for the whole map, all of whose weights are perturbed (Yan et al., ICCV 2023), for policy anm.

    Fewer rays and iterations than published (200 per frame of a window, 10 to 60 times a frame), which two cores cannot
    train; the noise has length one over all weights, as in the authors' code.
    """
    return MappingConfig(
        field=FieldConfig(log2_table_size=8, largest_log2_table_size=8),
        sampling=SamplingConfig(free_samples=4, near_samples=8),
        optimizer=OptimizerConfig(decoder_learning_rate=1.3e-3),
        schedule=ScheduleConfig(first_iterations=200, iterations=1, num_rays=200, min_current_rays=100, evenness=0.0),
        uncertainty=UncertaintyConfig(method="perturbation", noise_std=1.7e-3, color_weight=0.0),
        engine="mlp",
        surface_lattice_m=0.2,
    )


def quick_mapping() -> MappingConfig:
    """Half the levels and fewer iterations: for tests, sweeps and slow machines."""
    return MappingConfig(
        field=FieldConfig(num_levels=8, log2_table_size=15, largest_log2_table_size=16, finest_cell_m=0.04),
        schedule=ScheduleConfig(first_iterations=100, iterations=2, num_rays=384),
    )


def config_from_dict(values: dict[str, Any]) -> MappingConfig:
    """The configuration that ``dataclasses.asdict`` made ``values`` of.

    Raises:
        MapError: If a field is unknown or a value is out of range.
    """
    default = MappingConfig()
    try:
        built = {}
        for name, value in values.items():
            part = getattr(default, name, None)
            built[name] = type(part)(**_tuples(value)) if is_dataclass(part) else value
        return MappingConfig(**built)
    except TypeError as err:
        raise MapError(f"The mapping configuration has a field that this version does not know: {err}.") from err


def _tuples(values: dict[str, Any]) -> dict[str, Any]:
    """The same values with lists, as readers of files give them, as tuples."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}


MAPPING_PRESETS: dict[str, Callable[[], MappingConfig]] = {
    "default": default_mapping,
    "paper": paper_mapping,
    "quick": quick_mapping,
    "anm": anm_mapping,
}
"""Names of the presets, as given on the command line."""
