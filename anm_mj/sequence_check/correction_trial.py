"""Tries corrections on the frames that were read."""

import functools
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from anm_mj.io.sequence_poses import at_times
from anm_mj.sequence_check.correction import Correction, converted, corrected_camera, inverse, with_axes
from anm_mj.sequence_check.evidence import Evidence
from anm_mj.sequence_check.misfit import RIM_WEIGHT, Misfit, colour_misfit, misfit, rim_misfit
from anm_mj.sequence_check.surfaces import Images, Surfaces, surfaces
from anm_mj.sequence_check.views import View


class CorrectionTrial:
    """Says how well the frames fit each other under a correction."""

    def __init__(self, evidence: Evidence) -> None:
        """Nothing is computed before it is asked for."""
        self.evidence = evidence
        self._images = functools.lru_cache(maxsize=2)(self._stacked)
        self._shown = functools.lru_cache(maxsize=4)(self._surfaces)
        self._poses = functools.lru_cache(maxsize=4)(self._all_poses)
        self._turned = functools.lru_cache(maxsize=4)(self._poses_of_views)
        self._index = np.array([view.index for view in evidence.views])

    def misfit(self, correction: Correction, *, thin: bool = False) -> Misfit:
        """Of all pairs, under a correction; its offset of colour and its up axis do not count. ``thin``: each pair is
        looked at one way round only, for a first look.
        """
        pairs = self.evidence.pairs[:: 2 if thin else 1]
        poses = self.view_poses(correction)
        return misfit(self.shown(correction), pairs, inverse(poses[pairs[:, 1]]) @ poses[pairs[:, 0]])

    def colour_cost(self, correction: Correction) -> Float64[np.ndarray, " d"]:
        """Of colour alone, under a correction with its offset of colour."""
        pairs = self.evidence.pairs
        depth = self.view_poses(correction)
        colour = self.view_poses(
            replace(correction, time_offset_s=correction.time_offset_s + correction.colour_offset_s)
        )
        to = inverse(colour)
        one, other = pairs[:, 0], pairs[:, 1]
        shown = self.shown(correction)
        rim = rim_misfit(shown, to @ depth)
        pair = colour_misfit(shown, pairs, to[one] @ depth[one], to[other] @ depth[one])
        return pair + RIM_WEIGHT * rim[one]

    def shown(self, correction: Correction) -> Surfaces:
        """The surfaces of the views."""
        return self._shown(correction.focal_scale, correction.ray_depth, correction.mirrored)

    def view_poses(self, correction: Correction) -> Float64[np.ndarray, "v 4 4"]:
        """Poses of the views' cameras in units of the stated depth."""
        found = self._turned(correction.convention, correction.axes, correction.time_offset_s).copy()
        found[:, :3, 3] *= correction.pose_scale / correction.depth_scale
        return found

    def all_poses(self, correction: Correction) -> Float64[np.ndarray, "n 4 4"]:
        """Poses of all frames' cameras, x right, y down, z forward, in the stated unit."""
        return self._poses(correction.convention, correction.axes)

    def _surfaces(self, focal_scale: float, ray_depth: bool, mirrored: bool) -> Surfaces:
        camera = corrected_camera(self.evidence.camera, Correction(focal_scale=focal_scale))
        return surfaces(self._images(mirrored), camera, ray_depth=ray_depth)

    def _stacked(self, mirrored: bool) -> Images:
        return Images([_mirrored(view) if mirrored else view for view in self.evidence.views])

    def _poses_of_views(self, convention: str, axes: str, time_offset_s: float) -> Float64[np.ndarray, "v 4 4"]:
        poses, times = self._poses(convention, axes), self.evidence.times_s
        if time_offset_s == 0.0:
            return poses[self._index]
        return at_times(poses, times, times[self._index] + time_offset_s)

    def _all_poses(self, convention: str, axes: str) -> Float64[np.ndarray, "n 4 4"]:
        return with_axes(converted(self.evidence.poses, convention), axes)


def _mirrored(view: View) -> View:
    width = view.grey.shape[1]
    inverse, grey, steep = (image[:, ::-1].copy() for image in (view.inverse_m, view.grey, view.steep))
    rim = view.rim * np.array([1, -1]) + np.array([0, width - 1])
    return replace(view, inverse_m=inverse, grey=grey, steep=steep, rim=np.maximum(rim, 0))
