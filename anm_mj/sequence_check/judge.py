"""Costs of corrections on the frames that were read."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int64

from anm_mj.sequence_check.correction import Correction, at_times, converted, corrected_camera, inverse, with_axes
from anm_mj.sequence_check.misfit import RIM_WEIGHT, Misfit, colour_misfit, misfit, rim_misfit
from anm_mj.sequence_check.views import Surfaces, View, surfaces
from anm_mj.types import Intrinsics


@dataclass(frozen=True)
class Evidence:
    """What a sequence states, and what of it was read."""

    poses: Float64[np.ndarray, "n 4 4"]
    """Of all frames, as stated."""
    times_s: Float64[np.ndarray, " n"]
    views: tuple[View, ...]
    camera: Intrinsics
    """Of the views, as stated."""
    pairs: Int64[np.ndarray, "d 2"]
    """Indices into the views, each pair both ways round, one after the other."""


class Judge:
    """Says how well the frames fit each other under a correction."""

    def __init__(self, evidence: Evidence) -> None:
        """Nothing is computed before it is asked for."""
        self.evidence = evidence
        self._views = [list(evidence.views), [_mirrored(view) for view in evidence.views]]
        self._grey = [np.stack([view.grey for view in views]) for views in self._views]
        self._shown = functools.lru_cache(maxsize=4)(self._surfaces)
        self._poses = functools.lru_cache(maxsize=4)(self._all_poses)
        self._index = np.array([view.index for view in evidence.views])

    def misfit(self, correction: Correction, *, thin: bool = False) -> Misfit:
        """Of all pairs, under a correction; its offset of colour and its up axis do not count.

        Args:
            correction: What is put right first.
            thin: Whether each pair is looked at one way round only, for a first look.
        """
        pairs = self.evidence.pairs[:: 2 if thin else 1]
        poses = self.view_poses(correction)
        return misfit(
            self.shown(correction),
            self._grey[correction.mirrored],
            pairs,
            inverse(poses[pairs[:, 1]]) @ poses[pairs[:, 0]],
        )

    def colour_cost(self, correction: Correction) -> Float64[np.ndarray, " d"]:
        """Of colour alone, under a correction with its offset of colour."""
        pairs = self.evidence.pairs
        depth = self.view_poses(correction)
        colour = self.view_poses(
            replace(correction, time_offset_s=correction.time_offset_s + correction.colour_offset_s)
        )
        to = inverse(colour)
        one, other = pairs[:, 0], pairs[:, 1]
        grey, shown = self._grey[correction.mirrored], self.shown(correction)
        steep = np.stack([view.steep for view in self._views[correction.mirrored]])
        rim = rim_misfit(shown, steep, to @ depth)
        pair = colour_misfit(shown, grey, pairs, to[one] @ depth[one], to[other] @ depth[one])
        return pair + RIM_WEIGHT * rim[one]

    def shown(self, correction: Correction) -> Surfaces:
        """The surfaces of the views."""
        return self._shown(correction.focal_scale, correction.ray_depth, correction.mirrored)

    def view_poses(self, correction: Correction) -> Float64[np.ndarray, "v 4 4"]:
        """Poses of the views' cameras in units of the stated depth."""
        evidence = self.evidence
        poses = self._poses(correction.convention, correction.axes)
        if correction.time_offset_s == 0.0:
            found = poses[self._index].copy()
        else:
            found = at_times(poses, evidence.times_s, evidence.times_s[self._index] + correction.time_offset_s)
        found[:, :3, 3] *= correction.pose_scale / correction.depth_scale
        return found

    def all_poses(self, correction: Correction) -> Float64[np.ndarray, "n 4 4"]:
        """Poses of all frames' cameras, x right, y down, z forward, in the stated unit."""
        return self._poses(correction.convention, correction.axes)

    def _surfaces(self, focal_scale: float, ray_depth: bool, mirrored: bool) -> Surfaces:
        camera = corrected_camera(self.evidence.camera, Correction(focal_scale=focal_scale))
        return surfaces(self._views[mirrored], camera, ray_depth=ray_depth)

    def _all_poses(self, convention: str, axes: str) -> Float64[np.ndarray, "n 4 4"]:
        return with_axes(converted(self.evidence.poses, convention), axes)


def _mirrored(view: View) -> View:
    width = view.grey.shape[1]
    inverse, grey, steep = (image[:, ::-1].copy() for image in (view.inverse_m, view.grey, view.steep))
    rim = view.rim * np.array([1, -1]) + np.array([0, width - 1])
    return replace(view, inverse_m=inverse, grey=grey, steep=steep, rim=np.maximum(rim, 0))
