"""The oracle: a policy that knows the scene, for what the others are to be measured by.

It knows the true surface, which of it can be seen and where the robot can go, and looks for a short tour that covers it
before it makes the first step (:mod:`anm_mj.evaluation.oracle.tour`). It drives that tour in the simulator like every
other policy, and keeps account of what the frames cover; when the tour has ended it looks for another one through what
is left, from places that are chosen for it (:mod:`anm_mj.evaluation.oracle.residual_tour`). Its steps are an estimate
of the fewest possible from above, not a proof: no tour is known to be shorter, and none is known not to be.

What was found is kept in the user's cache folder under a name made from everything it depends on.
"""

from __future__ import annotations

import hashlib
import logging
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, UInt64

from anm_mj.errors import PlanError
from anm_mj.evaluation.coverage import COVERED_M, Coverage
from anm_mj.evaluation.depth import reduce_depth
from anm_mj.evaluation.oracle.cache import load_tour, store_tour
from anm_mj.evaluation.oracle.discretize import shorter, turned, walk
from anm_mj.evaluation.oracle.residual_tour import exact_bits, finer_places
from anm_mj.evaluation.oracle.roadmap import Ways, num_places
from anm_mj.evaluation.oracle.segments import NO_YAW, Pieces
from anm_mj.evaluation.oracle.tour import MISSING_STEPS, WARM_STEPS, Level, Stop, Task, TourSearch, greedy_tour
from anm_mj.evaluation.oracle.visibility import WORD, count, frame_bits, pack, unpack
from anm_mj.evaluation.pixel_rays import NUM_YAWS, PixelRays
from anm_mj.evaluation.scene_truth import SceneTruth
from anm_mj.frames import move_pose
from anm_mj.planning.policies.context import PolicyConfig, PolicyContext
from anm_mj.protocols import Mapper
from anm_mj.types import TURN_STEP_RAD, Action, Observation, Plan, Pose2, StopReason
from anm_mj.utils.raycast import RayCaster

_logger = logging.getLogger(__name__)

METHOD = 3
"""Raised when the search changes, so that tours that older versions kept are not used."""
LEVELS = ((0.5, 0.3), (0.7, 0.3), (0.8, 0.5), (0.9, 1.0), (0.95, 1.0), (0.99, 0.5))
"""Shares of the observable surface, and how much the steps to each count: one tour is made for all of them, and the
lower ones lead the search to tours that see much early."""
LAST_WEIGHT = 0.5
"""How much the steps to everything else count, once the first tour has been driven."""
LAST_MISSING_STEPS = 40.0
"""What a sample short of a level costs then [steps]."""
SLACK = 0.002
"""Planned beyond a level, since not everything that a view promises is kept."""
PLACE_SPACING_M = 0.25
"""Spacing of the places to look from [m], wider in scenes with more than ``MAX_PLACES``."""
MAX_PLACES = 2500
MAX_SAMPLES = 8192
"""Samples of the observable surface that the first tour is planned with."""
MAX_KEPT = 32768
"""Samples that account is kept of."""
MAX_REST = 1024
"""Samples that a tour through what is left is planned with."""
MAX_FAILURES = 2
"""A sample that so many tours have promised and not shown is given up."""
MAX_TOURS = 8
"""Tours in all."""
NUM_STARTS = 4
"""Tours that half of the changes are spent on; the best of them gets the other half."""
ROUNDS_AFTER = 20_000
"""Changes tried of each tour through what is left."""
SEED = 0
AHEAD_M = 0.1
"""How far before the robot an obstacle is that has blocked it [m], beyond its own radius."""


@dataclass(frozen=True)
class OracleConfig(PolicyConfig):
    """How long the policy searches for tours."""

    rounds: int = 100_000
    """Changes tried of the first tour."""


class Oracle:
    """Goes where it knows that something is left to see."""

    Config = OracleConfig

    def __init__(self, context: PolicyContext[OracleConfig]) -> None:
        """Take the scene's truth in.

        Raises:
            PlanError: The truth or the observable part of the surface is not known.
        """
        scene = context.truth
        if not isinstance(scene, SceneTruth):
            raise PlanError("This policy needs the true scene, and the context does not hold it.")
        truth = scene.surface
        if truth.observable is None:
            raise PlanError(
                "This policy needs the observable surface; pip install 'anm-mj[embree]' brings what finds it."
            )
        observable = truth.samples[truth.observable]
        chosen = np.random.default_rng(SEED).permutation(len(observable))
        planned = min(len(chosen), MAX_SAMPLES) // WORD * WORD
        self._samples = observable[np.sort(chosen[:planned])]
        self._kept = np.concatenate([self._samples, observable[np.sort(chosen[planned:MAX_KEPT])]])
        """Samples that account is kept of, those that the first tour is planned with before the others."""
        self._coverage = Coverage(self._kept)
        self._truth, self._floor, self._camera = truth, scene.reachable, scene.camera
        self._rounds = context.settings.rounds
        self._yaw_rad: float | None = None
        self._stops = list[Stop]()
        self._stop: Stop | None = None
        """The stop that the robot is on its way to."""
        self._tried_again: Stop | None = None
        """The last stop whose way was blocked."""
        self._place = 0
        """Where the robot is, or nearly so."""
        self._failures = np.zeros(len(self._kept), np.int64)
        """How many tours have promised each sample and not shown it."""
        self._promised = np.zeros(0, np.int64)
        """Samples that the present tour promises, those of the first tour left out."""
        self._avoided = list[Float[np.ndarray, "2"]]()
        """Spots that have blocked the robot."""
        self._tours = 0

    def observe(self, observation: Observation) -> None:
        """Keep account of what the frames cover."""
        depth_mm = reduce_depth(observation.depth_m)
        self._coverage.add(depth_mm, observation.intrinsics, observation.T_world_camera)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The way to the next stop of the tour, or the end when nothing is left."""
        del mapper  # What is true needs no map.
        pose = observation.pose
        if self._yaw_rad is None:
            self._yaw_rad = pose.yaw_rad
            self._ways = Ways(self._floor, self._spacing_m)
            self._place = int(self._ways.nearest(pose.xy_m[None])[0])
        left = self._coverage.distance_m >= COVERED_M
        while True:
            while self._stops:
                self._stop = self._stops.pop(0)
                actions = self._actions(pose, self._stop)
                self._place = self._stop[0]
                if actions:
                    done = 100.0 * (1.0 - left.mean())
                    reason = f"{done:.1f} % covered, {len(self._stops)} stops left"
                    return Plan(reason, np.zeros((0, 2)), actions=actions)
            self._stops = self._next_tour(pose, left)
            if not self._stops:
                return Plan("nothing is left to see", np.zeros((0, 2)), stop=StopReason.COMPLETE)

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Make the spot ahead dear, so that the next way leads round it, and plan anew."""
        self._avoided.append(move_pose(pose, AHEAD_M, 0.0).xy_m)
        self._ways.avoid(self._avoided[-1])
        self._place = int(self._ways.nearest(pose.xy_m[None])[0])
        if self._stop is not None and self._stop != self._tried_again:
            # A second time it is left out.
            self._stops.insert(0, self._stop)
            self._tried_again = self._stop
        del action  # Only moves forward are ever blocked.

    def _yaw(self, pose: Pose2) -> int:
        """Number of the yaw at which the robot stands."""
        assert self._yaw_rad is not None
        return round(math.remainder(pose.yaw_rad - self._yaw_rad, math.tau) / TURN_STEP_RAD) % NUM_YAWS

    def _actions(self, pose: Pose2, stop: Stop) -> tuple[Action, ...]:
        """What leads from where the robot stands to a stop."""
        assert self._yaw_rad is not None
        place, towards, side = stop
        yaws = [self._yaw(pose)]
        actions = list[Action]()
        if place != self._place:
            here_m = self._ways.places_m[[self._place]]
            line_m = np.concatenate([pose.xy_m[None], here_m, self._ways.corners_m(self._place, place)])
            way = walk(pose.xy_m, yaws[0], self._ways.straightened(line_m)[1:], self._ways, self._yaw_rad)
            for direction, moves in zip(way.yaws, way.moves, strict=True):
                actions += _turns(yaws[-1], direction, shorter(yaws[-1], direction))
                actions += [Action.MOVE_FORWARD] * moves
                yaws.append(direction)
        if towards != NO_YAW:
            actions += _turns(yaws[-1], towards, side)
        return tuple(actions)

    def _next_tour(self, pose: Pose2, left: Bool[np.ndarray, " n"]) -> list[Stop]:
        """A tour through what is left."""
        self._tours += 1
        self._failures[self._promised[left[self._promised]]] += 1
        stops = self._first_tour(pose, left) if self._tours == 1 else []
        return stops if stops or self._tours > MAX_TOURS else self._rest_tour(pose, left)

    def _first_tour(self, pose: Pose2, left: Bool[np.ndarray, " n"]) -> list[Stop]:
        """A tour through everything."""
        total = len(self._samples)
        bits = frame_bits(self._samples, self._ways.places_m, self._rays)
        seen = pack(~left[None, :total])[0]
        have, most = int(count(seen)), int(count(_union(bits) | seen))
        wanted = [(min(math.ceil((share + SLACK) * total), most), weight) for share, weight in LEVELS]
        levels = tuple(Level(samples, weight) for samples, weight in wanted if samples > have)
        # In a large scene a sample costs more steps, and what is missing of a level must not be the cheaper way.
        missing_steps = MISSING_STEPS * self._spacing_m / PLACE_SPACING_M
        return self._search(Task(self._place, self._yaw(pose), seen, levels), bits, self._rounds, missing_steps)

    def _rest_tour(self, pose: Pose2, left: Bool[np.ndarray, " n"]) -> list[Stop]:
        """A tour through what is left after others, from places that are chosen for it."""
        which = np.flatnonzero(left & (self._failures < MAX_FAILURES))
        if not len(which):
            return []
        rest = np.sort(np.random.default_rng(SEED).permutation(which)[:MAX_REST])
        samples = self._kept[rest]
        self._ways = Ways(self._floor, self._spacing_m, finer_places(samples, self._floor, self._rays))
        for spot_m in self._avoided:
            self._ways.avoid(spot_m)
        self._place = int(self._ways.nearest(pose.xy_m[None])[0])
        bits = exact_bits(samples, self._ways.places_m, self._rays)
        shown = _union(bits)
        most = int(count(shown))
        if most == 0:
            return []
        self._promised = rest[np.flatnonzero(unpack(shown))]
        # What is to be covered of these for a share of all that account is kept of.
        wanted = [
            (math.ceil((share + SLACK - 1.0) * len(left) / max(len(which), 1) * len(rest)) + len(rest), weight)
            for share, weight in LEVELS
        ]
        levels = [Level(samples, weight) for samples, weight in wanted if 0 < samples < most]
        task = Task(self._place, self._yaw(pose), np.zeros_like(shown), (*levels, Level(most, LAST_WEIGHT)))
        return self._search(task, bits, min(self._rounds, ROUNDS_AFTER), LAST_MISSING_STEPS)

    def _search(
        self, task: Task, bits: UInt64[np.ndarray, "p yaws words"], rounds: int, missing_steps: float
    ) -> list[Stop]:
        """A tour for a task: one that was found before, or the best that is found now."""
        assert self._yaw_rad is not None
        if not task.levels:
            return []
        digest = hashlib.sha256(self._ways.places_m.tobytes() + bits.tobytes()).hexdigest()
        key = f"{self._key}\0{digest}\0{task.place}\0{task.yaw}\0{task.levels}\0{rounds}".encode()
        known = load_tour(key + task.seen.tobytes())
        if known is not None:
            return known
        pieces = Pieces(bits, self._ways, self._yaw_rad)
        search = TourSearch(pieces, self._ways, task, SEED, missing_steps)
        begin = greedy_tour(pieces, self._ways, task, self._yaw_rad)
        each = rounds // (2 * NUM_STARTS)
        tours = [search.improve(begin, each) for _ in range(NUM_STARTS)]
        found = search.improve(min(tours, key=search.cost), rounds - NUM_STARTS * each, WARM_STEPS)
        steps, covered = search.curve(found)
        _logger.info("tour of %d steps and %d stops, for %d samples", steps[-1], len(found), covered[-1])
        store_tour(key + task.seen.tobytes(), found)
        return found

    @cached_property
    def _spacing_m(self) -> float:
        """Spacing of the places of the first tour [m]."""
        spacing_m = PLACE_SPACING_M
        while num_places(self._floor, spacing_m) > MAX_PLACES:
            spacing_m *= 1.15
        return spacing_m

    @cached_property
    def _rays(self) -> PixelRays:
        assert self._yaw_rad is not None
        return PixelRays(RayCaster(self._truth.vertices, self._truth.faces), self._camera, self._yaw_rad)

    @cached_property
    def _key(self) -> str:
        """A name for what all tours depend on."""
        digest = hashlib.sha256(f"{METHOD}\0{self._camera.intrinsics}\0{self._yaw_rad:.6f}\0".encode())
        for part in (self._samples, self._truth.vertices, self._truth.faces, self._floor.reachable):
            digest.update(np.ascontiguousarray(part).tobytes())
        digest.update(np.array([*self._floor.origin_xy_m, self._floor.resolution_m]).tobytes())
        # The same camera read off two poses differs in the last digits.
        digest.update((np.round(self._camera.T_base_camera, 6) + 0.0).tobytes())
        return digest.hexdigest()


def _turns(a: int, b: int, side: int) -> list[Action]:
    """The turns from one yaw to another, to the left (1) or to the right (-1)."""
    return [Action.TURN_LEFT if side > 0 else Action.TURN_RIGHT] * len(turned(a, b, side))


def _union(bits: UInt64[np.ndarray, "p yaws words"]) -> UInt64[np.ndarray, " words"]:
    """What any frame covers."""
    return np.bitwise_or.reduce(bits.reshape(-1, bits.shape[2]), axis=0)
