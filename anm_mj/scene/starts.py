"""Random start poses of episodes."""

import math

import numpy as np

from anm_mj.errors import SceneError
from anm_mj.scene.folder import Scene
from anm_mj.scene.navigable import is_clear, scene_area
from anm_mj.types import Footprint, Pose2

_ATTEMPTS = 1000
"""The grid of standing places is accurate to one cell, so a few of its cells fail the exact test."""


def sample_start(scene: Scene, footprint: Footprint, random: np.random.Generator) -> Pose2:
    """A pose drawn uniformly from the largest connected area of a scene, with a uniform heading. Raises SceneError if
    there is hardly a place to stand.
    """
    places = scene_area(scene, footprint).places(1)
    for _ in range(_ATTEMPTS):
        x, y = places[random.integers(len(places))].tolist()
        pose = Pose2(x, y, math.pi - random.uniform(0.0, math.tau))
        if is_clear(scene, pose, footprint):
            return pose
    raise SceneError(f"Scene {scene.name} has no clear place for the robot; check it with `anm-mj scene check`.")
