"""Settings of the mapping stage: one frozen dataclass per part, and the presets. Imports no torch, so it is quick."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from anm_mj.errors import MapError
from anm_mj.utils.settings import Settings, setting

ENGINES = ("auto", "native", "torch", "mlp")
"""Names of the engines that compute the map, see :mod:`anm_mj.mapping.backends.select`."""
DEVICES = ("auto", "cpu", "cuda")
"""Names of what they compute on."""
GEOMETRIES = ("field", "occupancy")
UNCERTAINTY_METHODS = ("last_layer_variance", "closed_form", "perturbation")
"""How the uncertainty can be computed, see :mod:`anm_mj.mapping.uncertainty`."""


@dataclass(frozen=True)
class FieldConfig(Settings, group="mapping.field", error=MapError):
    """Shape of the neural field: a hash grid and a one-blob code in metric world coordinates, and two decoders."""

    num_levels: int = setting(16, at_least=1, at_most=32)
    """Levels of the hash grid; each holds 2 features per entry."""
    log2_table_size: int = setting(16, at_least=8, at_most=22)
    """Binary logarithm of the number of entries per level at the start."""
    largest_log2_table_size: int = setting(17, at_most=22)
    """Up to this the table doubles as the scene grows; at or below ``log2_table_size`` it keeps its size."""
    entries_per_m3: float = 120.0
    """The table doubles when it has fewer entries per level than this for each cubic metre of the occupancy grid's
    blocks that hold surface (about 1 m3 to a square metre of surface) [1/m3]."""
    finest_cell_m: float = 0.01
    """Edge of a cell on the finest level [m]."""
    coarsest_cell_m: float = 0.6
    """Edge of a cell on the coarsest level [m]; the levels between grow geometrically."""
    torus_min_cell_m: float = setting(0.25, at_least=0.0)
    """Levels with cells at least this large [m] index their entries by position modulo a box, free of collisions inside
    it (for 2^16 entries 64 x 64 x 16 cells, at least 16 x 16 x 4 m); finer levels are hashed."""
    blob_bins: int = setting(16, at_least=4, at_most=256)
    """Bins of the one-blob code per axis."""
    blob_period_m: tuple[float, float, float] = (16.0, 16.0, 4.0)
    """Lengths along world x, y, z after which the one-blob code repeats [m]."""
    hidden_width: int = setting(32, at_most=4096)
    """Neurons in the one hidden layer of each decoder."""
    geometry_features: int = setting(15, at_most=4096)
    """Outputs of the SDF decoder beside s; they feed the colour decoder."""
    truncation_m: float = 0.1
    """Distance at which the SDF saturates [m]; the network's s is a fraction of it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.finest_cell_m > self.coarsest_cell_m:
            raise MapError(
                f"mapping.field.finest_cell_m is {self.finest_cell_m}; it must be at most coarsest_cell_m, "
                f"{self.coarsest_cell_m}."
            )


@dataclass(frozen=True)
class SamplingConfig(Settings, group="mapping.sampling", error=MapError):
    """Where samples lie along a training ray."""

    scheme: Literal["guided", "uniform"] = setting("guided", choices=("guided", "uniform"))
    """"guided": free samples end at the surface's band, none behind it. "uniform": free samples span [0, far_m]
    whatever the depth (the paper's own, after Co-SLAM)."""
    free_samples: int = setting(2, at_most=1024)
    """Samples per ray outside the band about the surface."""
    near_samples: int = setting(4, at_most=1024)
    """Samples per ray within the truncation distance of the measured depth."""
    far_m: float = 5.0
    """Planar depth up to which rays without a surface are sampled, and all rays of the uniform scheme; no farther than
    ``max_depth_m`` [m]."""
    max_depth_m: float = setting(10.0, at_most=13.1)
    """Depth beyond this counts as none [m]; stored pixels reach no farther than 13.1 m
    (:data:`anm_mj.mapping.keyframes.DEPTH_UNIT_M`)."""

    @property
    def reach_m(self) -> float:
        """Up to where rays are sampled: beyond ``max_depth_m``, a ray without depth may have met a surface [m]."""
        return min(self.far_m, self.max_depth_m)

    @property
    def samples_per_ray(self) -> int:
        """Number of samples on every ray."""
        return self.free_samples + self.near_samples


@dataclass(frozen=True)
class LossConfig(Settings, group="mapping.loss", error=MapError):
    """Weights of the five loss terms (paper, section IV-B)."""

    rgb: float = setting(5.0, at_least=0.0)
    """Weight of the colour term."""
    depth: float = setting(0.1, at_least=0.0)
    """Weight of the rendered-depth term [1/m^2]."""
    sdf: float = setting(1000.0, at_least=0.0)
    """Weight of the term on samples in the truncation band [1/m^2]."""
    free_space: float = setting(10.0, at_least=0.0)
    """Weight of the term on samples in front of the band."""
    smoothness: float = setting(0.0, at_least=0.0)
    """Weight of the feature smoothness term; 0 leaves its samples out."""
    smoothness_points: int = setting(31, at_least=2, at_most=128)
    """Points along each edge of the random lattice that the smoothness term is taken on."""
    smoothness_spacing_m: float = 0.1
    """Distance between neighbours on that lattice [m]."""
    no_depth_rgb: float = setting(0.05, at_least=0.0)
    """Factor on the colour residual of rays without depth."""
    no_depth_is_free: bool = True
    """Whether a pixel without depth says that nothing is there up to ``SamplingConfig.far_m``, as it does for sky in a
    simulator, or nothing at all, as with a scanner that loses dark or glossy surfaces."""


@dataclass(frozen=True)
class OptimizerConfig(Settings, group="mapping.optimizer", error=MapError):
    """Adam, with one learning rate for the table and one for the decoders."""

    table_learning_rate: float = 1e-2
    """Learning rate of the hash table."""
    decoder_learning_rate: float = 1e-2
    """Learning rate of both decoders."""
    beta1: float = setting(0.9, at_least=0.0, below=1.0)
    """Decay of the first moment."""
    beta2: float = setting(0.99, at_least=0.0, below=1.0)
    """Decay of the second moment."""
    epsilon: float = 1e-15
    """Added to the root of the second moment; tiny, so that entries seen once still learn."""
    decoder_weight_decay: float = setting(1e-6, at_least=0.0)
    """L2 penalty on the decoders' weights."""


@dataclass(frozen=True)
class ScheduleConfig(Settings, group="mapping.schedule", error=MapError):
    """How much is trained, when, and on what; counted in steps and iterations, never in seconds."""

    first_iterations: int = setting(200, at_least=0)
    """Iterations on the first frame."""
    iterations: int = setting(5, at_least=0, at_most=10_000)
    """Iterations on each training step."""
    train_every: int = setting(1, at_most=1e9)
    """Train on each n-th frame."""
    num_rays: int = setting(512, at_most=65_536)
    """Rays per iteration drawn from the keyframes."""
    min_current_rays: int = setting(26, at_most=65_536)
    """Rays per iteration drawn from the frame at hand, beside the keyframes' own; more while keyframes are few."""
    keyframe_every: int = setting(5, at_most=1e9)
    """Each n-th frame becomes a keyframe, the first one always."""
    pixel_share: float = setting(1.0, at_most=1.0)
    """Share of a keyframe's pixels that is kept for replay, in (0, 1]."""
    density_exponent: float = setting(0.5, at_least=0.0, at_most=1.0)
    """Keyframes keep pixels in proportion to observation_count^-density_exponent of the place that they show, in
    [0, 1]: 0 replays each place as often as it was observed, 1 replays all surface alike."""
    final_iterations: int = setting(2000, at_least=0)
    """Iterations after the last frame, at learning rates that fall from a half to a sixteenth; where the goal of a run
    is its coverage alone there are none."""
    replay_bytes: int = setting(256_000_000, at_least=1_000_000, at_most=64e9)
    """Memory for keyframes [bytes]; when it is full, each keyframe gives up a random half of its pixels."""


@dataclass(frozen=True)
class OccupancyConfig(Settings, group="mapping.occupancy", error=MapError):
    """The grid of free, occupied and unknown voxels fused from depth."""

    voxel_m: float = setting(0.05, at_least=0.005, at_most=1.0)
    """Edge of a voxel [m]."""
    hit_range_m: float = 8.0
    """Planar depth up to which a pixel marks its voxel occupied [m]."""
    carve_range_m: float = 5.0
    """Planar depth up to which space in front of surfaces becomes free [m]."""
    hit: int = 10
    """Added to a voxel's log-odds for a frame with a surface in it (in tenths)."""
    miss: int = 2
    """Taken from a voxel's log-odds for a frame that looks through it (in tenths)."""
    limit: int = setting(60, at_most=127)
    """Bound on the size of a voxel's log-odds (in tenths), so that it can change its mind."""
    no_depth_is_free: bool = True
    """Whether pixels that looked farther than the sensor's range carve up to there, at most ``carve_range_m``: those
    that the sensor says did, and large squares of lost ones about which all is near the end of the range."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("hit", "miss"):
            if getattr(self, name) > self.limit:
                raise MapError(
                    f"mapping.occupancy.{name} is {getattr(self, name)}; it must be at most limit, {self.limit}."
                )


@dataclass(frozen=True)
class MovingConfig(Settings, group="mapping.moving", error=MapError):
    """What the map does about things that move (:mod:`anm_mj.mapping.moved_pixels`)."""

    detect: bool = False
    """Whether pixels that moved are looked for, and left out; ``--people`` asks for it unless this says otherwise."""
    free_looks: int = setting(4, at_least=1, at_most=30)
    """A voxel is surely free after so many frames more looked through it than hit it."""
    stay: int = setting(1, at_least=1, at_most=127)
    """Added to a voxel's log-odds for a frame with something moved in it (in tenths): what stays becomes surface."""
    memory_frames: int = setting(60, at_least=0)
    """So many frames after something moved, looking through voxels near there counts as much as a hit."""
    held_frames: int = setting(20, at_least=1, at_most=10000)
    """What moves and is taken for an obstacle is one for so many frames, each time again for twice as many, or until
    it is looked through."""


@dataclass(frozen=True)
class UncertaintyConfig(Settings, group="mapping.uncertainty", error=MapError):
    """How the uncertainty of the map at a point is computed."""

    method: str = setting("last_layer_variance", choices=UNCERTAINTY_METHODS)
    """"last_layer_variance": variance under the posterior of the decoder's last layer over the observation count; of
    the three it predicts the true error best. "perturbation": sample variance over noisy decoders (paper, Eq. 4).
    "closed_form": the first-order limit of that for infinitely many passes, at the cost of two."""
    noise_std: float = 0.02
    """Standard deviation b of the Gaussian noise on every decoder weight."""
    num_passes: int = setting(20, at_least=2, at_most=1000)
    """Number of noisy decoders."""
    color_weight: float = setting(1.0, at_least=0.0)
    """Weight of the mean variance of the colour channels (in [0, 1]) against that of s (in truncations)."""


@dataclass(frozen=True)
class MappingConfig(Settings, group="mapping", error=MapError):
    """Settings of the mapping stage.

    By default many small batches of depth-guided rays; places with few observations get more than their share.
    """

    field: FieldConfig = FieldConfig()
    sampling: SamplingConfig = SamplingConfig()
    loss: LossConfig = LossConfig()
    optimizer: OptimizerConfig = OptimizerConfig()
    schedule: ScheduleConfig = ScheduleConfig()
    occupancy: OccupancyConfig = OccupancyConfig()
    moving: MovingConfig = MovingConfig()
    uncertainty: UncertaintyConfig = UncertaintyConfig()
    engine: Literal["auto", "native", "torch", "mlp"] = setting("auto", choices=ENGINES)
    """What computes: "native" (C++ on the CPU), "torch" (any device), or "auto": torch with the device "cuda",
    else native. These give the same map up to rounding. "mlp" is another map: one network without a grid (Yan et al.,
    ICCV 2023), in torch."""
    geometry: str = setting("field", choices=GEOMETRIES)
    """What decides between free and occupied where something was observed: the neural ``field``, or ``occupancy``, the
    grid of raw depth; with engine "mlp" always the latter."""
    surface_lattice_m: float = setting(0.1, at_least=0.01, at_most=1.0)
    """Spacing of the lattice on which zero-crossings are looked for [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.engine == "mlp" and self.uncertainty.method == "last_layer_variance":
            raise MapError("mapping.uncertainty.method is 'last_layer_variance'; engine mlp has no such layer.")


def paper_mapping() -> MappingConfig:
    """The paper's own training effort and sampling (section IV-B, with the numbers of its released code)."""
    return MappingConfig(
        field=FieldConfig(largest_log2_table_size=16),
        sampling=SamplingConfig(scheme="uniform", free_samples=32, near_samples=11, far_m=4.0),
        loss=LossConfig(smoothness=1e-5, no_depth_is_free=False),
        optimizer=OptimizerConfig(table_learning_rate=1e-3),
        schedule=ScheduleConfig(
            iterations=10,
            train_every=5,
            num_rays=2048,
            min_current_rays=100,
            pixel_share=0.05,
            density_exponent=0.0,
            final_iterations=0,
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
        schedule=ScheduleConfig(
            first_iterations=200,
            iterations=1,
            num_rays=200,
            min_current_rays=100,
            density_exponent=0.0,
            final_iterations=0,
        ),
        uncertainty=UncertaintyConfig(method="perturbation", noise_std=1.7e-3, color_weight=0.0),
        engine="mlp",
        surface_lattice_m=0.2,
    )


def quick_mapping() -> MappingConfig:
    """Half the levels and fewer iterations: for tests, sweeps and slow machines."""
    return MappingConfig(
        field=FieldConfig(num_levels=8, log2_table_size=15, largest_log2_table_size=16, finest_cell_m=0.04),
        schedule=ScheduleConfig(first_iterations=100, iterations=2, num_rays=384, final_iterations=200),
    )


def config_from_dict(values: dict[str, Any]) -> MappingConfig:
    """The inverse of ``dataclasses.asdict``. Raises MapError for an unknown field, or a value out of range."""
    from anm_mj.utils.read_file import convert  # Settings alone should not cost the import of numpy.

    try:
        config = convert(values, MappingConfig)
    except ValueError as err:
        raise MapError(f"The mapping configuration is damaged: {err}.") from err
    _require_known(values, config)
    return config


def _require_known(values: dict[str, Any], config: Any) -> None:
    for name, value in values.items():
        if not hasattr(config, name):
            raise MapError(f"The mapping configuration has a field that this version does not know: {name!r}.")
        if isinstance(value, dict):
            _require_known(value, getattr(config, name))


MAPPING_PRESETS: dict[str, Callable[[], MappingConfig]] = {
    "default": MappingConfig,
    "paper": paper_mapping,
    "quick": quick_mapping,
    "anm": anm_mapping,
}
"""Names of the presets, as given on the command line."""
