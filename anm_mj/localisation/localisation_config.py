"""Settings of localisation; light enough for the command line."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from anm_mj.errors import MapError
from anm_mj.utils.settings import Settings, setting

if TYPE_CHECKING:
    from anm_mj.mapping.alignment import AlignSettings


@dataclass(frozen=True)
class RegistrationConfig(Settings, group="localisation.registration", error=MapError):
    """How one frame is registered to the field."""

    num_points: int = setting(800, at_least=50, at_most=65_536)
    """Pixels of a frame that are registered."""
    range_m: float = 8.0
    """Pixels farther away are left out [m]."""
    border_m: float = setting(0.0, at_least=0.0)
    """Surface so near to what the map does not know is not registered to [m]. With 0.15 the field draws no camera that
    turns before a plain wall along it."""
    iterations: int = setting(30, at_most=1000)
    """Most steps of Gauss-Newton."""
    shrink_iterations: int = setting(4, at_least=0)
    """Steps over which the kernel on distances shrinks."""
    first_kernel: float = 20.0
    """Width of the kernel on distances at first, in standard deviations."""
    kernel: float = 2.5
    """Width of it at the end."""
    field_deviation_m: float = 0.01
    """Standard deviation of the field's surface [m]."""
    color_deviation: float = setting(0.1, at_least=0.0)
    """Standard deviation of a colour channel in [0, 1]; 0 leaves colours out."""
    color_kernel: float = 2.0
    """Width of the kernel on colours, in standard deviations."""
    information: float = 0.1
    """Residuals of neighbouring pixels err together: a frame's information is this share of the sum over its pixels."""
    search_least_rad: float = 0.008
    """A rotation with a larger standard deviation is searched for by earlier images first [rad]."""
    search_least_view_rad: float = 0.008
    """So is a displacement with a larger one, as seen from the camera at the median depth of the frame [rad]."""
    retry_cost: float = setting(2.0, at_least=1.0)
    """A frame that costs more than this many times what frames cost of late may be in a wrong place: it is registered
    from several starts."""
    retry_vague_cost: float = setting(1.25, at_least=1.0)
    """From a vague prior, so is a frame that costs more than this many times: a nearer start finds the surface."""
    retry_least_m: float = 0.025
    """A prior is vague if its position has a larger standard deviation [m]."""
    retry_least_rad: float = 0.025
    """A prior is vague, too, if its rotation has a larger standard deviation [rad]."""
    retry_prior: float = setting(4.0, at_least=0.0)
    """A frame with a larger squared deviation from its prior, in variances per direction of motion, is registered from
    several starts, too."""
    retry_starts: int = setting(12, at_least=0, at_most=1000)
    """Most starts of such a frame beside the first."""
    retry_deviations: float = setting(1.5, at_least=0.0)
    """They are drawn with so many standard deviations of the prior, or with ``retry_least_m`` and ``retry_least_rad``
    where these are larger."""
    retry_points: int = setting(300, at_least=50)
    """Pixels that a start is tried with."""
    retry_agreeing: int = setting(3, at_least=1, at_most=1000)
    """No further start is tried once so many have ended where it costs least so far."""
    retry_gain: float = setting(0.9, at_least=0.0, at_most=1.0)
    """The best start replaces the first if it costs less than this share."""
    most_prior: float = setting(9.0, at_least=0.0)
    """A pose with a larger squared deviation from its prior, in variances per direction of motion, is not believed of
    one frame."""
    still_m: float = 4e-4
    """The search ends with a step that moves the camera by less [m]."""
    still_rad: float = 3e-4
    """And turns it by less [rad]."""

    def settings(self, share: float) -> AlignSettings:
        """How residuals are weighted after a share of the shrinking, in [0, 1]."""
        from anm_mj.mapping.alignment import AlignSettings  # Settings alone should not cost the import of numpy.

        kernel = self.first_kernel * (self.kernel / self.first_kernel) ** share
        return AlignSettings(kernel, self.field_deviation_m, self.color_deviation, self.color_kernel)


@dataclass(frozen=True)
class KeyImageConfig(Settings, group="localisation.key_images", error=MapError):
    """Earlier frames that a frame is registered to, beside the field."""

    num_images: int = setting(2, at_least=0, at_most=100)
    """So many of them; 0 = the field alone."""
    most_images: int = setting(300, at_least=2, at_most=100_000)
    """So many are kept at most; then one of those that are most alike goes."""
    num_points: int = setting(3000, at_least=50, at_most=65_536)
    """Pixels of a frame that are compared with them."""
    longest_px: int = setting(256, at_least=16, at_most=4096)
    """They are reduced to at most so many pixels along the longer side."""
    least_overlap: float = 0.5
    """An image is wanted that shows at least this share of the frame's points."""
    most_apart_m: float = 2.0
    """Images taken farther away show too little alike [m]."""
    least_cosine: float = setting(0.5, at_least=-1.0, at_most=1.0)
    """Cosine of the angle between the cameras' axes, at least."""
    deviation_m: float = 0.005
    """Standard deviation of a distance to an image's surface, beside the sensors' noise [m]."""
    reach_m: float = 0.3
    """Points that are farther from it are another surface [m]."""
    edge_share: float = 0.03
    """Where an image's depth bends by a larger share of itself, it is an edge."""
    gray_deviation: float = setting(0.05, at_least=0.0)
    """Standard deviation of a grey value in [0, 1]; 0 leaves them out."""
    gray_kernel: float = 2.0
    """Width of the kernel on grey values, in standard deviations."""


@dataclass(frozen=True)
class MotionConfig(Settings, group="localisation.motion", error=MapError):
    """How far the prior of a frame's pose is believed."""

    odometry_alpha: tuple[float, float, float, float] = setting((0.01, 0.01, 0.01, 0.01), at_least=0.0)
    """Odometry: variance of a rotation from rotation [rad^2/rad^2] and from translation [rad^2/m^2], of a translation
    from translation [m^2/m^2] and from rotation [m^2/rad^2]. Source: Thrun, Burgard and Fox, Probabilistic Robotics,
    2005, table 5.6."""
    odometry_floor: tuple[float, float] = (0.002, 0.002)
    """Odometry: standard deviations of any motion, at least: of its translation [m], of its rotation [rad]."""
    learn_frames: int = setting(30, at_least=1, at_most=10_000)
    """Frames over which is learnt, from what registration corrects, how much noisier motions are than expected."""
    free_share: float = 0.5
    """Constant velocity: standard deviation of a frame's motion as a share of the motion before it."""
    free_translation_m: float = 0.01
    """Constant velocity: and at least this, of the displacement [m]."""
    free_rotation_rad: float = 0.015
    """Constant velocity: and at least this, of the rotation [rad]."""


@dataclass(frozen=True)
class CompassConfig(Settings, group="localisation.compass", error=MapError):
    """How far walls that are parallel to earlier ones tell the heading; only of a base on the floor."""

    is_on: bool = True
    """Whether walls tell the heading."""
    deviation_rad: float = 0.0005
    """Standard deviation of a wall's direction from that of others like it, at least [rad]."""
    noise_share: float = 1.5
    """What the pixels' noise explains of it counts so many times, as they err together."""
    most_deviation_rad: float = 0.0012
    """Walls whose direction that leaves more uncertain have no say [rad]."""
    apart_rad: float = 0.01
    """Walls that deviate by more from every known direction have one of their own [rad]."""
    alone_rad: float = 0.06
    """Of directions that are nearer to each other only one that prevails tells headings [rad]."""
    learn_walls: int = setting(40, at_least=1, at_most=10_000)
    """A direction is the mean over so many walls that had it first."""
    reach_deviations: float = 4.0
    """A heading counts that deviates from the prior's by at most so many standard deviations,"""
    most_turn_rad: float = 0.3
    """and by at most this [rad]."""
    first_kernel: float = 10.0
    """Width of the kernel on headings at first, in standard deviations."""
    kernel: float = 3.0
    """Width of it at the end: walls that are not quite parallel lose their say."""


@dataclass(frozen=True)
class TrackingConfig(Settings, group="localisation.tracking", error=MapError):
    """When a pose is good enough, and how much is trained meanwhile."""

    least_inliers: float = setting(0.35, at_least=0.0, at_most=1.0)
    """A frame enters the map when at least this share of its known points fits."""
    least_known: float = setting(0.1, at_least=0.0, at_most=1.0)
    """With fewer known points the map says nothing of a pose; the prior's stays."""
    least_agreement: float = setting(0.7, at_least=0.0, at_most=1.0)
    """And when of the points that the occupancy grid knows something of, it confirms at least this share."""
    most_deviation_m: float = 0.05
    """And when the standard deviation of its position is at most this [m]."""
    most_deviation_rad: float = 0.03
    """And that of its rotation at most this [rad]."""
    doubt_frames: int = setting(2, at_most=1000)
    """After so many frames in a row that do not fit, one has to score as a place that a lost camera is found at."""
    lost_frames: int = setting(5, at_most=1000)
    """So many frames in a row that do not fit make the camera lost."""
    young_frames: int = setting(60, at_least=0)
    """Mapped frames at first that are trained on with ``young_iterations``."""
    young_iterations: int = setting(15, at_most=10_000)
    """Training iterations on each of the first frames, which decide all later drift, and of those with new surface."""
    iterations: int = setting(5, at_most=10_000)
    """Training iterations on later ones."""
    keyframe_every: int = setting(5, at_most=1e9)
    """Each n-th mapped frame becomes a keyframe."""
    fresh_keyframe_every: int = setting(1, at_most=1e9)
    """Each n-th of the first frames, and of those that show much new surface."""
    familiar: float = setting(0.9, at_least=0.0, at_most=1.0)
    """A frame of whose points a smaller share is known shows much new surface."""
    current_rays: int = setting(250, at_least=1, at_most=65_536)
    """Rays per iteration from the frame at hand at most: with too many the map follows the error of its pose."""


@dataclass(frozen=True)
class GraphConfig(Settings, group="localisation.graph", error=MapError):
    """Poses of keyframes that are corrected by what is measured between them."""

    adjust: bool = False
    """Whether the poses of the latest keyframes are adjusted with each new one (bundle adjustment)."""
    loops: bool = True
    """Whether a place that is seen again corrects all keyframes since (loop closure)."""
    images: int = setting(3, at_least=1, at_most=100)
    """Earlier keyframes that a new one is registered to."""
    window: int = setting(30, at_least=1, at_most=100_000)
    """So many of the latest keyframes are adjusted; a loop adjusts all but the first."""
    iterations: int = setting(5, at_most=1000)
    """Steps of Gauss-Newton for a registration."""
    first_kernel: float = 10.0
    """Width of the kernel on distances at first, in standard deviations."""
    kernel: float = 2.5
    """Width of it at the end."""
    information: float = 0.1
    """Share of the sum over the pixels that a registration is believed by, as neighbouring pixels err together."""
    chain_m: float = 0.005
    """Standard deviation of the estimated displacement from one keyframe to the next, by field and odometry [m]."""
    chain_rad: float = 0.003
    """Standard deviation of the estimated rotation from one keyframe to the next [rad]."""
    edge_kernel: float = 10.0
    """Width of the kernel on the deviation of a registration from the graph, in standard deviations."""
    least_overlap: float = setting(0.35, at_least=0.0, at_most=1.0)
    """A keyframe must show at least this share of the points,"""
    least_fit: float = setting(0.5, at_least=0.0, at_most=1.0)
    """and they must fit it at least so well, in [0, 1]."""
    loop_keyframes: int = setting(40, at_least=2, at_most=100_000)
    """A place is seen again after so many keyframes at least,"""
    loop_m: float = 0.02
    """and with a deviation of more than this [m],"""
    loop_confirmations: int = setting(3, at_least=1, at_most=1000)
    """which so many keyframes in a row have to say alike,"""
    loop_chi_square: float = 16.0
    """and all other measurements must allow, by the squared deviation in standard deviations."""
    loop_every: int = setting(10, at_least=1, at_most=100_000)
    """After so many keyframes that show a place again, all measurements together are asked for a correction."""
    rebuild_m: float = 0.03
    """Corrections that add up to more than this [m] rebuild the occupancy grid from the keyframes, and train the field
    again,"""
    rebuild_iterations: int = setting(100, at_least=0, at_most=100_000)
    """with so many iterations."""

    @property
    def is_on(self) -> bool:
        """Whether keyframes are measured against each other."""
        return self.adjust or self.loops


@dataclass(frozen=True)
class RelocalisationConfig(Settings, group="localisation.relocalisation", error=MapError):
    """How a lost camera is looked for."""

    cell_m: float = setting(0.1, at_least=0.02, at_most=1.0)
    """Cell of the grid of distances [m]."""
    truncation_m: float = 0.4
    """Largest distance of a point that counts [m]."""
    unknown_m: float = 0.15
    """What a point in unknown space counts as [m]."""
    range_m: float = 5.0
    """Pixels farther away take no part in the search [m]."""
    spacing_m: float = 0.2
    """Spacing of the places that are tried [m]."""
    headings: int = setting(36, at_most=360)
    """Headings that are tried at each."""
    search_points: int = setting(100, at_most=10_000)
    """Points of a frame that all places are scored by."""
    refine_points: int = setting(300, at_most=10_000)
    """Points that the best ones are refined by."""
    candidates: int = setting(12, at_least=2, at_most=1000)
    """Places that are registered to the field, and hypotheses that are kept."""
    most_distance_m: float = 0.15
    """Places with a larger mean distance are none [m]."""
    deviation_m: float = 0.15
    """Standard deviation of a candidate's place [m]."""
    deviation_rad: float = 0.1
    """And of its heading [rad]."""
    iterations: int = setting(15, at_most=1000)
    """Most steps of Gauss-Newton for each."""
    least_known: float = 0.5
    """A frame of whose points the map knows a smaller share counts for less."""
    least_score: float = setting(0.7, at_most=1.0)
    """A place is believed whose mean score over frames is at least this, in [0, 1],"""
    usual_share: float = setting(0.9, at_most=1.0)
    """or this share of what frames scored while the camera was tracked,"""
    expected_share: float = setting(0.8, at_most=1.0)
    """(and where it would be, had it not been lost, this share of either: before unknown space frames score less)"""
    least_lead: float = setting(0.2, at_least=0.0)
    """leads every other by at least this over the root of the frames that both were compared with,"""
    frames: int = setting(4, at_most=1000)
    """over at least so many frames."""
    carried_m: float = setting(3.0, at_least=0.0)
    """Places farther from where odometry has the camera [m]"""
    carried_frames: int = setting(1000, at_most=100_000)
    """are believed from so many frames after it was lost on, unless images show its motion all along; a robot gives up
    long before. For robots that people carry about 40, a whole rotation in which a nearer place may fit."""

    def least(self, usual_score: float) -> float:
        """The score from which on a place is believed, where frames scored so much of late; NaN = nobody knows."""
        return self.least_score if math.isnan(usual_score) else min(self.least_score, self.usual_share * usual_score)

    def registration(self, usual: RegistrationConfig) -> RegistrationConfig:
        """The settings by which a candidate is registered."""
        return replace(usual, iterations=self.iterations, shrink_iterations=self.iterations // 2)


@dataclass(frozen=True)
class LocalisationConfig:
    """Settings of the stage."""

    registration: RegistrationConfig = RegistrationConfig()
    key_images: KeyImageConfig = KeyImageConfig()
    motion: MotionConfig = MotionConfig()
    compass: CompassConfig = CompassConfig()
    tracking: TrackingConfig = TrackingConfig()
    graph: GraphConfig = GraphConfig()
    relocalisation: RelocalisationConfig = RelocalisationConfig()
