"""Localisation against the neural field while it is trained: the :class:`~.localiser.Localiser` of the project."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from anm_mj.errors import MapError
from anm_mj.localisation.coarse_search import distinct_tilts
from anm_mj.localisation.compass import WallCompass
from anm_mj.localisation.frame_points import draw_points, without_moved
from anm_mj.localisation.frame_to_images import FrameToImages, compared_with
from anm_mj.localisation.image_odometry import ImageOdometry
from anm_mj.localisation.key_images import KeyImage, KeyImages, key_image
from anm_mj.localisation.keyframe_graph import KeyframeGraph
from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.localisation.localiser import (
    BaseOfCamera,
    PoseEstimate,
    RegistrationQuality,
    TrackingState,
    largest_deviations,
)
from anm_mj.localisation.map_corrector import MapCorrector
from anm_mj.localisation.map_probe import MapProbe
from anm_mj.localisation.motion import MotionModel
from anm_mj.localisation.registration import FREE, PLANAR, Prior, Registration, RegistrationProblem
from anm_mj.localisation.relocaliser import Relocaliser
from anm_mj.localisation.tracking import Tracker, Verdict
from anm_mj.localisation.training_pace import TrainingPace
from anm_mj.localisation.wall_directions import Headings
from anm_mj.mapping.alignment import FramePoints
from anm_mj.types import MapUpdate, Observation, Pose2

if TYPE_CHECKING:
    from anm_mj.mapping.neural_map import NeuralMap

_Place = tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "k k"]]
"""Pose of a camera, and its covariance by the directions of motion."""
_FIRST_DEVIATION = 1e-4
"""Standard deviations of the first pose, at least [m, rad]: where nobody estimated it, it defines the world."""
_FEW_POINTS = 50
"""Frames with fewer measured points are blind."""


class FieldLocaliser:
    """Implements :class:`~.localiser.Localiser`: registers each frame to the field that is being trained.

    The first frame's pose is taken as it comes, with the deviations that it states: without any it defines the world.
    """

    REBUILT = ("_map", "_probe", "_compared")

    def __init__(
        self,
        neural_map: NeuralMap,
        config: LocalisationConfig,
        *,
        seed: int,
        planar: bool,
        odometry: bool,
        base_pose: Callable[[Float[np.ndarray, "4 4"]], Pose2] | None = None,
        lost: bool = False,
        tilts: Sequence[Float[np.ndarray, "4 4"]] = (),
    ) -> None:
        """Start before the first frame.

        Args:
            neural_map: What frames are registered to, and are mapped into by somebody else.
            config: Settings.
            seed: What the choice of points comes from.
            planar: Whether the camera moves with a base on the floor (x, y, yaw), at the height and tilt of the
                observations, or freely.
            odometry: Whether the poses of observations tell the motion between two frames; else it is as it was before.
            base_pose: What gives the base of a camera pose; None = the camera is mounted as at the first frame.
            lost: Whether there is a map already, in which of the first pose only height and tilt are known.
            tilts: Camera poses with heights and tilts that a lost camera may have, in the place of the first pose's.

        Raises:
            MapError: The engine of the map cannot localise.
        """
        if not neural_map.backend.can_align:
            raise MapError(
                f"The map's engine '{neural_map.backend.name}' cannot localise; take mapping.engine=native, --device "
                "cpu, and a policy without a map of its own kind."
            )
        self.config = config
        self._map, self._probe = neural_map, MapProbe(neural_map)
        self._seed, self._basis = seed, PLANAR if planar else FREE
        self._odometry = odometry
        self._base = BaseOfCamera(base_pose)
        self._tilts = tuple(tilts)
        self._num_frames = 0
        self._pace = TrainingPace(config.tracking)
        self._misfits = 0
        """Frames in a row that did not fit."""
        self._motion = MotionModel(config.motion, self._basis, has_odometry=odometry)
        self._state = TrackingState.LOST if lost else TrackingState.TRACKING
        self._relocaliser = Relocaliser(config, self._basis, self._probe)
        self._key_images = KeyImages(config.key_images)
        self._compass = WallCompass(config.compass, self._basis)
        self._headings: Headings | None = None
        self._graph = KeyframeGraph(config.graph, self._key_images, self._basis)
        self._corrector = MapCorrector(neural_map, self._graph, self._key_images, self._basis)
        self._compared: FrameToImages | None = None
        """The last frame, for a comparison with earlier ones; needed until it is integrated."""
        self._image_odometry = ImageOdometry(config, has_odometry=odometry)
        self._tracker = Tracker(config, self._probe, self._image_odometry, has_odometry=odometry)
        self._is_followed = True
        """Whether images show all motion since frames fitted."""
        self._is_guess = False
        """Whether nothing shows how the camera moved to the last frame: no odometry, not the map, and no image."""
        self._T_world_camera: Float[np.ndarray, "4 4"] | None = None
        self._T_fitting: Float[np.ndarray, "4 4"] | None = None
        """The last pose that the map confirmed."""
        self._far: _Place | None = None
        """Of the last frame, where only its distance from the prior spoke against it."""
        self._covariance = np.eye(self._basis.shape[1]) * _FIRST_DEVIATION**2

    @property
    def state(self) -> TrackingState:
        """As of the last frame."""
        return self._state

    def localise(self, observation: Observation) -> PoseEstimate:
        """Estimate the pose of the next frame; see the protocol."""
        self._num_frames += 1
        lost, noise, far = self._state is TrackingState.LOST, self._probe.noise_per_m, self._far
        self._compared = self._headings = self._far = None
        self._is_guess = False
        image = key_image(observation, self.config.key_images.longest_px, noise)
        if not self._map.is_trained or (self._T_world_camera is None and not lost):
            told = observation.position_deviation_m, observation.heading_deviation_rad
            deviations = np.maximum(told, _FIRST_DEVIATION)
            self._covariance = self._basis.T @ np.diag(np.repeat(deviations, 3) ** 2) @ self._basis
            first = Prior(observation.T_world_camera, self._covariance, self._basis)
            self._headings = self._compass.look(observation, first, self._probe.noise_of(observation)).headings
            self._compass.learn(observation.T_world_camera, float(deviations[1]))
            self._image_odometry.see(None if self._odometry else image)
            return self._estimate(observation, observation.T_world_camera, None, usable=True)
        prior = self._prior(observation)
        rng = np.random.default_rng([self._seed, 21, self._num_frames])
        settings = self.config.registration
        static_view = observation
        if self._map.config.moving.detect and not lost:
            static_view = without_moved(observation, self._map, prior.T_world_camera, prior.deviations)
        points = draw_points(static_view, settings.num_points, noise, settings.range_m, rng)
        if len(points) < _FEW_POINTS:
            self._is_followed = False
            prior = self._unless_guessed(prior, None)
            if lost and self._T_world_camera is not None:
                self._relocaliser.move(np.linalg.inv(self._T_world_camera) @ prior.T_world_camera, followed=False)
            return self._predicted(observation, prior, None, None, misfit=False)
        T = self._T_world_camera
        gone_on = None if T is None else self._motion.gone_on(T, self._covariance)
        if lost:
            return self._look_for(observation, prior, gone_on, points, image, rng)
        prior = self._compass.look(static_view, prior, self._probe.noise_of(static_view))
        self._headings = prior.headings
        compared = self._compared = self._compare(static_view, image, points, prior, rng)
        extra = compared if compared is not None and compared.num_images else None
        problem = RegistrationProblem(points, prior, self._probe, settings, extra)
        # Perhaps the last frame jumped rightly, or the motion went on while the camera was held.
        other = gone_on if far is None else self._prior(observation, far)
        believed = self._tracker.believed_score
        tracked = self._tracker.track(problem, other, compared, rng, misfits=self._misfits)
        found = tracked.found
        self._far = (found.T_world_camera, found.covariance) if tracked.verdict is Verdict.JUMPS else None
        if tracked.verdict is not Verdict.FITS:
            self._is_followed &= tracked.is_followed
            misfit = tracked.verdict is not Verdict.UNKNOWN
            prior = tracked.prior if tracked.is_followed else self._unless_guessed(tracked.prior, image)
            return self._predicted(observation, prior, found, image, misfit=misfit)
        self._misfits, self._T_fitting = 0, found.T_world_camera
        self._is_followed |= tracked.score >= believed
        self._tracker.history.add(found.mean_cost, tracked.score, tracked.image_fit)
        self._motion.learn(tracked.expected, found.T_world_camera)
        self._covariance = found.covariance
        estimate = self._estimate(observation, found.T_world_camera, found, usable=self._is_sure())
        self._compass.learn(found.T_world_camera, largest_deviations(estimate.covariance)[1])
        self._see(image, estimate)
        return estimate

    def integrate(self, estimate: PoseEstimate) -> MapUpdate:
        """Take a usable frame into the map; see the protocol."""
        effort = self._pace.next(estimate.quality.known, has_keyframes=len(self._map.field.keyframes) > 0)
        if effort.is_keyframe:
            noise = self._probe.noise_of(estimate.observation)
            self._key_images.add(estimate.observation, noise, estimate.covariance)
            # Corrections move it.
            self._image_odometry.see(self._key_images.images[-1])
        update = self._map.integrate(estimate.observation, effort)
        return replace(update, closes_loop=effort.is_keyframe and self._correct(estimate.observation))

    def close(self) -> None:
        """Forget the earlier frames, which take most of its memory: no frame is to come."""
        # The graph and the last comparison refer to the same images.
        self._key_images.images.clear()
        self._key_images.see(None)
        self._image_odometry.see(None)
        self._compared = None

    def _correct(self, observation: Observation) -> bool:
        """Add a keyframe to the graph, and move what it corrects; whether that closes a loop."""
        if not self._corrector.is_on:
            return False
        T, compared = observation.T_world_camera, self._compared
        if compared is None:
            rng, settings = np.random.default_rng([self._seed, 22]), self.config.registration
            points = draw_points(observation, settings.num_points, self._probe.noise_per_m, settings.range_m, rng)
            known = Prior(T, np.zeros_like(self._covariance), self._basis)
            compared = self._compare(observation, self._key_images.images[-1], points, known, rng)
            assert compared is not None
        if self._is_guess:
            self._corrector.break_chain()
        if (correction := self._corrector.add(compared, observation, self._headings)) is None:
            return False
        self._T_world_camera = correction.T_world_camera[-1]
        return correction.closed

    def _compare(
        self, static_view: Observation, image: KeyImage, points: FramePoints, prior: Prior, rng: np.random.Generator
    ) -> FrameToImages | None:
        """Compares a frame with earlier ones that overlap it; None where no image is needed."""
        T, slack_m = prior.T_world_camera, prior.deviations[0]
        images = self._key_images.overlapping(points, T, slack_m) if self.config.key_images.num_images else []
        self._key_images.refer_to(images, T)
        if not images and not self.config.graph.is_on and not self._image_odometry.has_last:
            return None
        noise, kept = self._probe.noise_per_m, self._key_images
        return compared_with(images, static_view, image, len(points), kept, self.config, noise, rng)

    def _look_for(
        self,
        observation: Observation,
        prior: Prior,
        gone_on: Prior | None,
        points: FramePoints,
        image: KeyImage,
        rng: np.random.Generator,
    ) -> PoseEstimate:
        """Look for a lost camera in the whole map."""
        noise, kept = self._probe.noise_per_m, self._key_images
        alone = compared_with([], observation, image, len(points), kept, self.config, noise, rng)
        followed = self._image_odometry.follow(alone, prior, doubtful=True)
        self._is_followed &= followed is not None
        prior = followed or self._unless_guessed(prior, image)
        finder = self._relocaliser
        if self._T_world_camera is not None:
            finder.move(np.linalg.inv(self._T_world_camera) @ prior.T_world_camera, followed=self._is_followed)
        if gone_on is not None:
            finder.propose(gone_on.T_world_camera)
        rng = np.random.default_rng([self._seed, 23, self._num_frames])
        believed = finder.look(points, self._possible_tilts(prior), rng, self._tracker.history.usual_score)
        if believed is None or believed.found is None:
            return self._predicted(observation, prior, None, image, misfit=False)
        finder.restart()
        self._state, self._misfits, self._is_followed = TrackingState.TRACKING, 0, True
        self._is_guess, self._T_fitting = False, believed.T_world_camera
        self._covariance = believed.found.covariance
        self._key_images.refer_to([], believed.T_world_camera)
        self._corrector.break_chain()
        usable = self._is_sure()
        found = self._estimate(observation, believed.T_world_camera, believed.found, usable=usable, relocalised=True)
        self._see(image, found)
        return found

    def _prior(self, observation: Observation, before: _Place | None = None) -> Prior:
        """Of the next frame, from the last one's place, or another that it may have had."""
        T_now = observation.T_world_camera
        if self._T_world_camera is None:
            return Prior(T_now, self._covariance, self._basis)
        place = before or (self._T_world_camera, self._covariance)
        return self._motion.prior(*place, T_now, self._T_world_camera if before else None)

    def _possible_tilts(self, prior: Prior) -> Sequence[Float[np.ndarray, "4 4"]]:
        """Camera poses with the heights and tilts that a lost camera may have."""
        tilts = self._tilts or (prior.T_world_camera,)
        # Without odometry, images that led astray have tilted the prior, too.
        return tilts if self._odometry or self._T_fitting is None else distinct_tilts([*tilts, self._T_fitting])

    def _unless_guessed(self, prior: Prior, image: KeyImage | None) -> Prior:
        """What is known of a frame, with this image or without, that neither map nor images place: what odometry says
        or, without any, that the camera was where it is held.
        """
        if self._odometry or self._T_world_camera is None:
            return prior
        self._is_guess = True
        return self._motion.hold(self._T_world_camera, self._covariance, has_image=image is not None)

    def _predicted(
        self,
        observation: Observation,
        prior: Prior,
        found: Registration | None,
        image: KeyImage | None,
        *,
        misfit: bool,
    ) -> PoseEstimate:
        """The prior's pose, for a frame that tells nothing, or contradicts the map."""
        self._covariance = prior.covariance
        is_astray = not (self._odometry or self._is_followed or self._is_sure())
        self._misfits += misfit or is_astray
        if self._misfits >= self.config.tracking.lost_frames and self._state is TrackingState.TRACKING:
            self._state = TrackingState.LOST
            # Perhaps only the frames were bad.
            self._relocaliser.restart(prior.T_world_camera, has_odometry=self._odometry, followed=self._is_followed)
        # Of a guess there should be something to map.
        is_worth_it = image is not None or not self._is_guess
        usable = not misfit and self._misfits == 0 and self._is_sure() and is_worth_it
        estimate = self._estimate(observation, prior.T_world_camera, found, usable=usable)
        self._see(image, estimate)
        return estimate

    def _see(self, image: KeyImage | None, estimate: PoseEstimate) -> None:
        """Take a frame's image at its pose; None = it shows nothing."""
        if image is not None:
            T_world_camera = estimate.observation.T_world_camera
            image = replace(image, T_world_camera=T_world_camera, covariance=estimate.covariance)
        # A camera that is held where its last image was taken may follow that one.
        if image is not None or not self._is_guess:
            self._image_odometry.see(image)
        self._key_images.see(image if self._is_followed else None)

    @property
    def _deviations(self) -> tuple[float, float]:
        """Of the pose within the map [m, rad]."""
        return largest_deviations(self._basis @ self._covariance @ self._basis.T)

    def _is_sure(self) -> bool:
        position_m, rotation_rad = self._deviations
        tracking = self.config.tracking
        return position_m <= tracking.most_deviation_m and rotation_rad <= tracking.most_deviation_rad

    def _estimate(
        self,
        observation: Observation,
        T_world_camera: Float[np.ndarray, "4 4"],
        found: Registration | None,
        *,
        usable: bool,
        relocalised: bool = False,
    ) -> PoseEstimate:
        # The jump from where it was believed to be, before it was lost, is no motion.
        before = T_world_camera if self._T_world_camera is None or relocalised else self._T_world_camera
        if not self._is_guess:
            self._motion.move(np.linalg.inv(before) @ T_world_camera, observation.T_world_camera)
        self._T_world_camera = T_world_camera
        fit = (0.0, 0.0, 0) if found is None else (found.known, found.inliers, found.bound)
        placed = replace(observation, T_world_camera=T_world_camera, pose=self._base.pose(observation, T_world_camera))
        position_m, rotation_rad = self._deviations
        told = replace(placed, position_deviation_m=position_m, heading_deviation_rad=rotation_rad)
        covariance = self._basis @ self._covariance @ self._basis.T + self._key_images.map_covariance(T_world_camera)
        usable = usable and self._state is TrackingState.TRACKING
        quality = RegistrationQuality(*fit)
        return PoseEstimate(told, covariance, quality, self._state, usable, relocalised, self._is_guess)
