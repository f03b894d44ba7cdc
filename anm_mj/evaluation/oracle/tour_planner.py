"""Tours for the oracle: a first one through the whole observable surface, then ones through the residual samples.

The user's cache folder keeps every tour under a name made from everything that it depends on.
"""

import hashlib
import json
import logging
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, UInt64

from anm_mj.evaluation.oracle.discretize import DiscretePath, discretize
from anm_mj.evaluation.oracle.residual_tour import exact_bits, select_places
from anm_mj.evaluation.oracle.roadmap import Roadmap, spread_places
from anm_mj.evaluation.oracle.segments import Segments
from anm_mj.evaluation.oracle.tour_annealing import MEASURES, WARM_STEPS, Measure, Stop, Task, TourAnnealer, greedy_tour
from anm_mj.evaluation.oracle.upper_bound import coverage_bound, earliest_steps
from anm_mj.evaluation.oracle.visibility import WORD, count, frame_bits, pack, unpack
from anm_mj.evaluation.oracle.warm_start import stops_along
from anm_mj.evaluation.scene_truth import SceneTruth
from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.ground_truth.pixel_rays import PixelRays
from anm_mj.types import TURN_STEP_RAD, Pose2
from anm_mj.utils.files import cache_folder, store_in_cache
from anm_mj.utils.raycast import RayCaster
from anm_mj.utils.read_file import read_json

_logger = logging.getLogger(__name__)

METHOD = 6
"""Version of the search; a higher one ignores tours that older versions cached."""
LEVELS = (0.5, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Shares of the observable surface; the greedy tour goes to the first that is not reached."""
SLACK = 0.002
"""Share planned beyond a level, because frames do not cover all that the plan expects."""
PLACE_SPACING_M = 0.25
"""Spacing of places [m]; wider in scenes with more than ``MAX_PLACES``."""
MAX_PLACES = 2500
MAX_PLANNED = 8192
"""Most samples that the first tour is planned with."""
MAX_SAMPLES = 32768
"""Most samples that are tracked."""
MAX_RESIDUAL = 1024
"""Most samples that a residual tour is planned with."""
MAX_FAILURES = 2
"""Tours that may expect a sample in vain before it is given up."""
MAX_TOURS = 8
NUM_STARTS = 4
"""Tours that share half of the rounds; the best of them gets the other half."""
NUM_WARM_STARTS = 2
"""Best tours of finished runs that are improved beside them."""
RESIDUAL_ROUNDS = 20_000
"""Annealing rounds of each residual tour."""
SEED = 0
_REMEMBERED = ("_tours", "_failures", "_expected", "_avoided", "_more_places_m")
"""What of a planner does not follow from the scene."""


class TourPlanner:
    """Plans tours for one of ``MEASURES`` through the samples of a known surface that are not covered yet.

    The yaw of the pose at the start is heading 0. The search for the first tour, of so many annealing rounds, also
    begins from the poses of finished runs.
    """

    def __init__(
        self,
        scene: SceneTruth,
        rounds: int,
        start: Pose2,
        measure: str = MEASURES[0],
        trajectories: Sequence[list[Pose2]] = (),
    ) -> None:
        self._scene = scene
        self._measure = measure
        self._trajectories = trajectories
        self._rounds = rounds
        self._yaw_rad = start.yaw_rad
        samples = scene.surface.samples[scene.surface.observable]
        chosen = np.random.default_rng(SEED).permutation(len(samples))
        planned = min(len(chosen), MAX_PLANNED) // WORD * WORD
        self._planned = samples[np.sort(chosen[:planned])]
        """Samples that the first tour is planned with."""
        self.samples = np.concatenate([self._planned, samples[np.sort(chosen[planned:MAX_SAMPLES])]])
        """The tracked samples, world [m]: the planned ones, then others."""
        self._rays = PixelRays(RayCaster(scene.surface.vertices, scene.surface.faces), scene.camera, self._yaw_rad)
        self._spacing_m = PLACE_SPACING_M
        while len(spread_places(scene.reachable, self._spacing_m)) > MAX_PLACES:
            self._spacing_m *= 1.15
        self._roadmap = Roadmap(scene.reachable, self._spacing_m)
        self._more_places_m: Float[np.ndarray, "k 2"] | None = None
        """Places of the roadmap beside the regular ones."""
        self._key = self._scene_key()
        self._tours = 0
        self._failures = np.zeros(len(self.samples), np.int64)
        """Number of tours that expected each sample in vain."""
        self._expected = np.zeros(0, np.int64)
        """Samples that the present residual tour should cover."""
        self._avoided = list[Float[np.ndarray, "2"]]()

    def next_tour(self, pose: Pose2, left: Bool[np.ndarray, " n"], steps_left: int) -> list[Stop]:
        """A tour from a pose through the tracked samples that are left; empty if nothing can be gained."""
        self._tours += 1
        self._failures[self._expected[left[self._expected]]] += 1
        stops = self._first_tour(pose, left, steps_left) if self._tours == 1 else []
        return stops if stops or self._tours > MAX_TOURS else self._residual_tour(pose, left, steps_left)

    def upper_bound(self, pose: Pose2) -> Float[np.ndarray, " steps"]:
        """Most of the planned samples that a tour from a pose can have covered after each step of the budget [%]."""
        area, places_m = self._scene.reachable, self._roadmap.places_m
        earliest = earliest_steps(area, places_m, pose.xy_m, self.yaw_at(pose), self._spacing_m)
        bound = coverage_bound(self._first_bits(), earliest, self._scene.budget_steps)
        return 100.0 * bound / len(self._planned)

    def _first_bits(self) -> UInt64[np.ndarray, "p yaws words"]:
        """What each frame covers of the planned samples."""
        return frame_bits(self._planned, self._roadmap.places_m, self._rays)

    def place_at(self, pose: Pose2) -> int:
        """The place nearest to a pose."""
        return int(self._roadmap.nearest(pose.xy_m[None])[0])

    def yaw_at(self, pose: Pose2) -> int:
        """The heading nearest to a pose's yaw."""
        return round(math.remainder(pose.yaw_rad - self._yaw_rad, math.tau) / TURN_STEP_RAD) % NUM_HEADINGS

    def path(self, pose: Pose2, here: int, there: int) -> DiscretePath:
        """The path from a pose near one place to another place."""
        roadmap = self._roadmap
        line_m = np.concatenate([pose.xy_m[None], roadmap.places_m[[here]], roadmap.path_m(here, there)])
        return discretize(pose.xy_m, self.yaw_at(pose), roadmap.shortcut_path(line_m)[1:], roadmap, self._yaw_rad)

    def avoid(self, spot_m: Float[np.ndarray, "2"]) -> None:
        """Lead all further paths round a spot [m]."""
        self._avoided.append(spot_m)
        self._roadmap.avoid(spot_m)

    def get_state(self) -> dict[str, Any]:
        """What was planned and met so far, for a checkpoint."""
        return {name: getattr(self, name) for name in _REMEMBERED}

    def set_state(self, state: dict[str, Any]) -> None:
        """Take over what :meth:`get_state` gave."""
        for name in _REMEMBERED:
            setattr(self, name, state[name])
        self._make_roadmap()

    def _make_roadmap(self) -> None:
        self._roadmap = Roadmap(self._scene.reachable, self._spacing_m, self._more_places_m)
        for spot_m in self._avoided:
            self._roadmap.avoid(spot_m)

    def _first_tour(self, pose: Pose2, left: Bool[np.ndarray, " n"], budget: int) -> list[Stop]:
        """A tour through all planned samples."""
        total = len(self._planned)
        bits = self._first_bits()
        seen = pack(~left[None, :total])[0]
        have, most = int(count(seen)), int(count(_union(bits) | seen))
        wanted = [min(math.ceil((share + SLACK) * total), most) for share in LEVELS]
        goal = min((samples for samples in wanted if samples > have), default=None)
        if goal is None:
            return []
        task = Task(self.place_at(pose), self.yaw_at(pose), seen, goal, Measure(self._measure, budget, total))
        known = [stops_along(poses, self.place_at, self.yaw_at, budget) for poses in self._trajectories]
        return self._search(task, bits, self._rounds, known)

    def _residual_tour(self, pose: Pose2, left: Bool[np.ndarray, " n"], budget: int) -> list[Stop]:
        """A tour through what other tours left, by places selected for it."""
        which = np.flatnonzero(left & (self._failures < MAX_FAILURES))
        if not len(which):
            return []
        residual = np.sort(np.random.default_rng(SEED).permutation(which)[:MAX_RESIDUAL])
        samples = self.samples[residual]
        self._more_places_m = select_places(samples, self._scene.reachable, self._rays)
        self._make_roadmap()
        bits = exact_bits(samples, self._roadmap.places_m, self._rays)
        visible = _union(bits)
        most = int(count(visible))
        if most == 0:
            return []
        self._expected = residual[np.flatnonzero(unpack(visible))]
        # Residual samples to cover for a share of all tracked samples.
        short = [(share + SLACK - 1.0) * len(left) / len(which) * len(residual) for share in LEVELS]
        wanted = [math.ceil(samples) + len(residual) for samples in short]
        goal = min([samples for samples in wanted if 0 < samples < most] + [most])
        measure = Measure(self._measure, budget, len(residual))
        task = Task(self.place_at(pose), self.yaw_at(pose), np.zeros_like(visible), goal, measure)
        return self._search(task, bits, min(self._rounds, RESIDUAL_ROUNDS))

    def _search(
        self, task: Task, bits: UInt64[np.ndarray, "p yaws words"], rounds: int, others: Sequence[list[Stop]] = ()
    ) -> list[Stop]:
        """A tour for a task: the cached one, or the best that the search finds, also from tours of others."""
        digest = hashlib.sha256(self._roadmap.places_m.tobytes() + bits.tobytes()).hexdigest()
        text = f"{self._key}\0{digest}\0{task.place}\0{task.yaw}\0{task.samples}\0{task.measure}\0{rounds}\0{others}"
        key = hashlib.sha256(text.encode() + task.seen.tobytes()).hexdigest()[:32]
        path = cache_folder("oracle") / f"{key}.json"
        known = _read_tour(path)
        if known is not None:
            return known
        segments = Segments(bits, self._roadmap, self._yaw_rad)
        search = TourAnnealer(segments, self._roadmap, task, SEED)
        begin = greedy_tour(segments, self._roadmap, task, self._yaw_rad)
        each = rounds // (2 * NUM_STARTS)
        begins = [begin] * NUM_STARTS + sorted(others, key=search.cost)[:NUM_WARM_STARTS]
        tours = [search.anneal(one, each) for one in begins]
        found = search.anneal(min(tours, key=search.cost), rounds - NUM_STARTS * each, WARM_STEPS)
        coverage = search.coverage(found)
        _logger.info(
            "Tour: %d stops, %d steps, %d samples.", len(found), int(coverage.steps[-1]), int(coverage.samples[-1])
        )
        store_in_cache(path, json.dumps(found).encode())
        return found

    def _scene_key(self) -> str:
        """A name for everything that all tours depend on."""
        surface, area, camera = self._scene.surface, self._scene.reachable, self._scene.camera
        digest = hashlib.sha256(f"{METHOD}\0{camera.intrinsics}\0{self._yaw_rad:.6f}\0".encode())
        for part in (self._planned, surface.vertices, surface.faces, area.reachable):
            digest.update(np.ascontiguousarray(part).tobytes())
        digest.update(np.array([*area.origin_xy_m, area.resolution_m]).tobytes())
        # The same camera read off two poses differs in the last digits.
        digest.update((np.round(camera.T_base_camera, 6) + 0.0).tobytes())
        return digest.hexdigest()


def _read_tour(path: Path) -> list[Stop] | None:
    """A cached tour; None if there is none, or it is damaged."""
    try:
        stops = read_json(path)
        return [(int(place), int(yaw), int(side)) for place, yaw, side in stops]
    except (OSError, ValueError, TypeError):
        return None


def _union(bits: UInt64[np.ndarray, "p yaws words"]) -> UInt64[np.ndarray, " words"]:
    """What any frame covers."""
    return np.bitwise_or.reduce(bits.reshape(-1, bits.shape[2]), axis=0)
