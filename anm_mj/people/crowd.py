"""People who walk from place to place, around the robot and each other, and things that move among them.

Each walks along a path to a place drawn from the seed, stands there for a while, and goes on. On the way a social force
(Helbing and Molnar, Physical Review E 51, 1995) drives it along the path and pushes it away from walls, other people
and the robot: exponentials of the distance between bodies as in Helbing, Farkas and Vicsek (Nature 407, 2000), weaker
for what lies behind (Johansson, Helbing and Shukla, Advances in Complex Systems 10, 2007). A step that would touch
somebody is not made, so people never walk into the robot. Where each goes, and for how long it stands, is drawn from
the seed; the way there depends on who else is in it, and who is stuck goes elsewhere.

A vacuum robot drives straight, and turns to a heading drawn from the seed where the next step would touch anything. A
chair is pushed once, straight to another place with room around it. Doors are those of
:mod:`anm_mj.people.door_leaves`.
"""

from __future__ import annotations

import copy
import math

import numpy as np
from jaxtyping import Float

from anm_mj.errors import SceneError
from anm_mj.people.door_leaves import DoorLeaves, distance_from_line
from anm_mj.people.people_config import PeopleConfig
from anm_mj.people.social_force import push
from anm_mj.people.walking_floor import BODY, WalkingFloor
from anm_mj.types import Footprint

PERIOD_S = 0.1
"""People move in periods of this length [s]."""
_RELAXATION_S, _FASTEST_SHARE = 0.5, 1.3
_WALL_MPS2, _WALL_M = 10.0, 0.08
_SLOW_MPS = 0.4
"""Forces on slower people are weaker in proportion: they would never get through a door."""
_TURNS_MPS = 0.1
"""Who moves faster than this turns to where it goes; slow people do from a quarter of their speed on."""
_AHEAD_M, _ARRIVED_M = 0.5, 0.3
_STUCK_S, _YIELD_S, _JAM_M, _SPOT_S = 5.0, 1.5, 1.0, 0.5
"""Who gets no farther in ``_STUCK_S`` than it walks in ``_SPOT_S`` chooses another place; in ``_YIELD_S`` already where
somebody before it in the list is within ``_JAM_M``, since two who meet would wait for each other."""
_YIELD_TRIES = 10
_NEAREST_GOAL_M = 2.0
_ROBOT_START_M, _APART_M = 1.5, 0.8
"""Nobody starts nearer than this to the robot, and to another one."""
_FOLLOW_M = 1.2  # Who follows the robot keeps this distance.
VACUUM, CHAIR = Footprint(radius_m=0.17, z_min_m=0.0, z_max_m=0.09), Footprint(radius_m=0.22, z_min_m=0.0, z_max_m=0.87)
_VACUUM_MPS, _CHAIR_MPS = 0.3, 0.5
_TURN_RADPS = 2.0
_FAR_M = 1e3  # A vacuum robot drives towards a place so far away, until it meets something.
_BERTH_M = 0.1  # Things stop so far before the robot.
_PUSHED_M, _CHAIR_CLEAR_M = 0.7, 0.7
"""A chair is pushed so far, with so much clearance before and after: others can pass it."""
_TRIES = 200
_STRIDE_PER_HEIGHT = 0.75  # A stride is two steps.


class Crowd:
    """The people of a scene, its vacuum robots and its chair, in this order, and doors; a copy moves on by itself."""

    REBUILT = ("config", "floor")

    def __init__(
        self,
        config: PeopleConfig,
        floor: WalkingFloor,
        robot_xy_m: Float[np.ndarray, "2"],
        robot_radius_m: float,
        seed: int,
    ) -> None:
        """Place everybody around a robot of this radius, which starts at a place [m]; ``seed`` is that of all that is
        random about them. Raises SceneError if the floor has no room for so many, or too few doorways for their doors.
        """
        self.config, self.floor = config, floor
        self._robot_radius_m = robot_radius_m
        self.height_m = np.random.default_rng([seed, 86]).uniform(1.5, 1.9, config.num_bodies)
        kinds = [BODY] * config.number + [VACUUM] * config.vacuums + [CHAIR] * config.has_chair
        self.radius_m = np.array([kind.radius_m for kind in kinds])
        """Of each body [m]."""
        self.doors = DoorLeaves(floor, config.doors, robot_xy_m)
        self._seed = seed
        self.restart(robot_xy_m)

    def restart(self, robot_xy_m: Float[np.ndarray, "2"], seed: int | None = None) -> None:
        """Place the same people anew at time 0, as of :meth:`__init__`; None = with the seed of before."""
        config, count = self.config, self.config.num_bodies
        self._seed = self._seed if seed is None else seed
        random = np.random.default_rng([self._seed, 83])
        self._num_periods = 0
        self.doors.shut(np.array([*robot_xy_m, self._robot_radius_m]))
        self._speed_mps = random.uniform(config.slowest_mps, config.fastest_mps, count)
        places = self._places(robot_xy_m, random)
        way = self._chair_way(np.vstack([robot_xy_m, places]), random) if config.has_chair else np.zeros((0, 2))
        self.xy_m = np.vstack([places, way[:1]])
        """Where everybody is [m]."""
        self.yaw_rad = random.uniform(-math.pi, math.pi, count)
        self.phase_rad = random.uniform(0.0, math.tau, count)
        """Of the gait: the left leg is foremost at a quarter of a turn."""
        self.swing = np.zeros(count)
        """How far the limbs swing, as a share of a fast walk's."""
        self._velocity_mps = np.zeros((count, 2))
        self._num_goals = np.zeros(count, np.int64)
        self._stand_until_s = random.uniform(0.0, max(config.longest_stand_s, 1e-9), count)
        self._progress_s, self._spot_m = np.zeros(count), self.xy_m.copy()
        """When each last came to another spot, and which [m]."""
        self._path: list[Float[np.ndarray, "k 2"]] = [self.xy_m[i : i + 1].copy() for i in range(count)]
        things = slice(config.number, config.number + config.vacuums)
        self._speed_mps[things], self._stand_until_s[config.number - config.followers : things.stop] = _VACUUM_MPS, 0.0
        for one in range(count)[things]:
            self._path[one] = _far_ahead(self.xy_m[one], self.yaw_rad[one])
        if config.has_chair:
            self._speed_mps[-1], self._stand_until_s[-1], self._path[-1] = _CHAIR_MPS, config.chair_pushed_s, way[1:]
        if config.blocked_s > 0.0:
            self.xy_m[0] = self.floor.doorway(robot_xy_m)
            self._next_goal(0, 0.0, False, robot_xy_m)  # It walks on from there.
            self._stand_until_s[0] = config.blocked_s

    def copied(self) -> Crowd:
        """The same people, to move on by themselves."""
        other = copy.copy(self)
        vars(other).update(
            {name: own.copy() for name, own in vars(self).items() if isinstance(own, (np.ndarray, list))}
        )
        other.doors = self.doors.copied()
        return other

    def _places(self, robot_xy_m: Float[np.ndarray, "2"], random: np.random.Generator) -> Float[np.ndarray, "n 2"]:
        """Of all but the chair."""
        places, found = self.floor.places_m, [robot_xy_m]
        for _ in range(self.config.number + self.config.vacuums):
            for _ in range(_TRIES):
                place = places[random.integers(len(places))]
                away_m = np.linalg.norm(np.array(found) - place, axis=1)
                if away_m[0] >= _ROBOT_START_M and (away_m[1:] >= _APART_M).all():
                    found.append(place)
                    break
            else:
                raise SceneError(
                    f"people.number is {self.config.number}, but the floor has room for {len(found) - 1} at "
                    f"{_APART_M:g} m from each other and {_ROBOT_START_M:g} m from the robot; give fewer people."
                    if not self.config.vacuums
                    else f"people.number and people.vacuums add up to {self.config.number + self.config.vacuums}, but "
                    f"the floor has room for {len(found) - 1}; give fewer."
                )
        return np.array(found[1:], float).reshape(-1, 2)

    def _chair_way(self, bodies_m: Float[np.ndarray, "n 2"], random: np.random.Generator) -> Float[np.ndarray, "2 2"]:
        """From where to where the chair is pushed, given where the robot and everybody else are [m]."""
        places = self.floor.places_m
        roomy = places[np.array([self.floor.clearance(x, y)[0] >= _CHAIR_CLEAR_M for x, y in places.tolist()])]
        apart_m = np.array([_ROBOT_START_M, *[_APART_M] * (len(bodies_m) - 1)])
        for start in random.permutation(roomy):
            ends = roomy[np.abs(np.linalg.norm(roomy - start, axis=1) - _PUSHED_M) < 0.05]
            if len(ends) and (np.linalg.norm(bodies_m - start, axis=1) >= apart_m).all():
                return np.array([start, ends[random.integers(len(ends))]])
        raise SceneError(
            f"The floor has no room to push a chair by {_PUSHED_M:g} m with {_CHAIR_CLEAR_M:g} m around it: set "
            "people.chair_pushed_s=0."
        )

    def follow(self, time_s: float, robot_xy_m: Float[np.ndarray, "2"]) -> bool:
        """Move on up to a time of the simulation [s], while the robot stands at a place [m]; whether anybody moved."""
        before = self._num_periods
        while self.next_s <= time_s + 1e-9:
            self._num_periods += 1
            if len(self.doors):
                self._move_doors(robot_xy_m)
            for one in range(len(self.xy_m)):
                (self._move if one < self.config.number else self._move_thing)(one, robot_xy_m)
        return self._num_periods > before

    def _move_doors(self, robot_xy_m: Float[np.ndarray, "2"]) -> None:
        """One period of the doors; who stands opens none, and followers never stand."""
        walking = np.flatnonzero(self._stand_until_s[: self.config.number] <= self._num_periods * PERIOD_S)
        ways_m = [np.vstack([self.xy_m[one], self._path[one]]) for one in walking.tolist()]
        bodies = [*np.column_stack([self.xy_m, self.radius_m]), [*robot_xy_m, self._robot_radius_m]]
        self.doors.move(ways_m, np.array(bodies), PERIOD_S)

    @property
    def next_s(self) -> float:
        """When everybody moves the next time [s]."""
        return (self._num_periods + 1) * PERIOD_S

    @property
    def chair(self) -> tuple[float, float, float] | None:
        """Where the chair stands, if there is one: x [m], y [m], yaw [rad]."""
        return (*self.xy_m[-1].tolist(), float(self.yaw_rad[-1])) if self.config.has_chair else None

    def touches(self, start_m: Float[np.ndarray, "2"], end_m: Float[np.ndarray, "2"]) -> bool:
        """Whether the robot would touch somebody on a straight line, and come nearer to them by it."""
        nearest_m = distance_from_line(self.xy_m, start_m, end_m)
        now_m = np.linalg.norm(self.xy_m - start_m, axis=1)
        return bool(((nearest_m < self._robot_radius_m + self.radius_m) & (nearest_m < now_m - 1e-6)).any())

    def distance_m(self, robot_xy_m: Float[np.ndarray, "2"]) -> float:
        """Between the robot's body and the nearest other one [m]; infinite without any."""
        away_m = np.linalg.norm(self.xy_m - robot_xy_m, axis=1)
        return float((away_m - self.radius_m).min(initial=math.inf)) - self._robot_radius_m

    def _move(self, one: int, robot_xy_m: Float[np.ndarray, "2"]) -> None:
        """One period of one person."""
        x, y = self.xy_m[one].tolist()
        vx, vy = self._velocity_mps[one].tolist()
        goal_x, goal_y, speed = self._steer(one, x, y, robot_xy_m)
        away = math.hypot(goal_x - x, goal_y - y)
        ax = ((goal_x - x) / away * speed if away > 1e-6 else 0.0) - vx
        ay = ((goal_y - y) / away * speed if away > 1e-6 else 0.0) - vy
        ax, ay = ax / _RELAXATION_S, ay / _RELAXATION_S
        others = self._others(one, robot_xy_m)
        if speed > 0.0:
            gently = min(speed / _SLOW_MPS, 1.0)
            for other_x, other_y, apart in others:
                push_x, push_y = push(other_x - x, other_y - y, apart, self.yaw_rad[one])
                ax, ay = ax + gently * push_x, ay + gently * push_y
            clear, slope_x, slope_y = self.floor.clearance(x, y)
            wall = gently * _WALL_MPS2 * math.exp((BODY.radius_m - clear) / _WALL_M)
            ax, ay = ax + wall * slope_x, ay + wall * slope_y
        vx, vy = vx + ax * PERIOD_S, vy + ay * PERIOD_S
        most = _FASTEST_SHARE * self._speed_mps[one] if speed > 0.0 else 0.0
        now = math.hypot(vx, vy)
        if now > most:
            vx, vy = vx * most / now, vy * most / now
        # The step, or its part along one axis, that leads into nothing and nobody; else none.
        steps = (vx * PERIOD_S, vy * PERIOD_S), (vx * PERIOD_S, 0.0), (0.0, vy * PERIOD_S)
        step_x, step_y = next((step for step in steps if self._is_free(one, *step, others)), (0.0, 0.0))
        self._put(one, x + step_x, y + step_y, step_x / PERIOD_S, step_y / PERIOD_S, bool(speed))

    def _move_thing(self, one: int, robot_xy_m: Float[np.ndarray, "2"]) -> None:
        """One period of a thing: towards its destination, where nothing is in the way; the chair does not turn."""
        ahead = self._path[one][-1] - self.xy_m[one]
        away_m, is_vacuum = math.hypot(*ahead), one < self.config.number + self.config.vacuums
        turn_rad = math.remainder(math.atan2(ahead[1], ahead[0]) - self.yaw_rad[one], math.tau) if is_vacuum else 0.0
        if abs(turn_rad) > 1e-6:
            most_rad = _TURN_RADPS * PERIOD_S
            self.yaw_rad[one] = math.remainder(self.yaw_rad[one] + max(min(turn_rad, most_rad), -most_rad), math.tau)
        elif self._num_periods * PERIOD_S >= self._stand_until_s[one] and away_m > 0.0:
            step = ahead * min(self._speed_mps[one] * PERIOD_S / away_m, 1.0)
            if self._is_free(one, float(step[0]), float(step[1]), self._others(one, robot_xy_m)):
                self.xy_m[one] += step
            elif is_vacuum:
                self._num_goals[one] += 1
                random = np.random.default_rng([self._seed, 84, one, int(self._num_goals[one])])
                back_rad = self.yaw_rad[one] + math.pi + random.uniform(-0.6, 0.6) * math.pi
                self._path[one] = _far_ahead(self.xy_m[one], back_rad)

    def _put(self, one: int, x: float, y: float, vx: float, vy: float, walks: bool) -> None:
        """Note where a person is now, and turn and swing its limbs as its velocity [m/s] says."""
        time_s, speed = self._num_periods * PERIOD_S, math.hypot(vx, vy)
        self.xy_m[one] = x, y
        # Who is pushed to and fro before somebody gets nowhere.
        if math.dist((x, y), self._spot_m[one]) > _SPOT_S * self._speed_mps[one] or not walks:
            self._progress_s[one], self._spot_m[one] = time_s, (x, y)
        self._velocity_mps[one] = vx, vy
        if speed > min(_TURNS_MPS, self._speed_mps[one] / 4):
            turn = math.remainder(math.atan2(vy, vx) - self.yaw_rad[one], math.tau)
            self.yaw_rad[one] = math.remainder(self.yaw_rad[one] + max(min(turn, 0.4), -0.4), math.tau)
        stride_m = _STRIDE_PER_HEIGHT * self.height_m[one]
        self.phase_rad[one] = (self.phase_rad[one] + math.tau * speed * PERIOD_S / stride_m) % math.tau
        self.swing[one] += 0.3 * (min(speed / 1.2, 1.0) - self.swing[one])

    def _steer(self, one: int, x: float, y: float, robot_xy_m: Float[np.ndarray, "2"]) -> tuple[float, float, float]:
        """The place that a person steers for [m], and the speed it wants to have [m/s]."""
        time_s = self._num_periods * PERIOD_S
        follows = one >= self.config.number - self.config.followers
        if follows:
            near = math.dist((x, y), robot_xy_m) < self._robot_radius_m + _FOLLOW_M
            if near or self._num_periods % 10 == 1:
                here = self.xy_m[one]
                self._path[one] = here[None].copy() if near else self.floor.path(here, robot_xy_m)
            self._progress_s[one] = time_s
        elif self._stands(one, x, y, time_s, robot_xy_m):
            return x, y, 0.0
        path = self._path[one]
        if len(path) == 1:
            return float(path[0, 0]), float(path[0, 1]), 0.0 if follows else float(self._speed_mps[one])
        away_m = np.hypot(path[:, 0] - x, path[:, 1] - y)
        # What was passed is forgotten.
        nearest = int(away_m.argmin())
        self._path[one] = path = path[nearest:]
        ahead = min(round(_AHEAD_M / 0.1), len(path) - 1)
        return float(path[ahead, 0]), float(path[ahead, 1]), float(self._speed_mps[one])

    def _stands(self, one: int, x: float, y: float, time_s: float, robot_xy_m: Float[np.ndarray, "2"]) -> bool:
        """Whether a person stands; one who has come to where it went, or gets nowhere, is given another place."""
        if time_s < self._stand_until_s[one]:
            return True
        there = math.dist((x, y), self._path[one][-1]) < _ARRIVED_M
        yields = (np.linalg.norm(self.xy_m[:one] - self.xy_m[one], axis=1) < _JAM_M).any()
        stuck = bool(time_s - self._progress_s[one] > (_YIELD_S if yields else _STUCK_S))
        return (there or stuck) and not self._next_goal(one, time_s, stuck, robot_xy_m)

    def _next_goal(self, one: int, time_s: float, stuck: bool, robot_xy_m: Float[np.ndarray, "2"]) -> bool:
        """Choose the next place and the time to stand before; whether the person walks already. Who is stuck turns away
        from the nearest body.
        """
        self._num_goals[one] += 1
        random = np.random.default_rng([self._seed, 84, one, int(self._num_goals[one])])
        places, here = self.floor.places_m, self.xy_m[one]
        others = np.vstack([np.delete(self.xy_m, one, axis=0), robot_xy_m])
        away = here - others[np.linalg.norm(others - here, axis=1).argmin()]
        path, ways = here[None], self.floor.ways(here)
        for _ in range(_YIELD_TRIES):
            goal, tries = here, 0
            while math.dist(goal, here) < _NEAREST_GOAL_M and tries < _TRIES:
                goal, tries = places[random.integers(len(places))], tries + 1
            path = ways(goal)
            if not stuck or (path[min(round(_AHEAD_M / 0.1), len(path) - 1)] - here) @ away > 0.0:
                break
        self._path[one] = path
        self._progress_s[one], self._spot_m[one] = time_s, here
        if not stuck:
            self._stand_until_s[one] = time_s + random.uniform(0.0, max(self.config.longest_stand_s, 1e-9))
        return stuck

    def _others(self, one: int, robot_xy_m: Float[np.ndarray, "2"]) -> list[tuple[float, float, float]]:
        """Where everybody else and the robot are, and how far from there one's middle touches them [m]."""
        apart_m = (self.radius_m + self.radius_m[one]).tolist()
        others = [(*self.xy_m[k].tolist(), apart_m[k]) for k in range(len(self.xy_m)) if k != one]
        berth_m = _BERTH_M if one >= self.config.number else 0.0
        robot_apart_m = float(self.radius_m[one]) + self._robot_radius_m + berth_m
        return [*others, (float(robot_xy_m[0]), float(robot_xy_m[1]), robot_apart_m)]

    def _is_free(self, one: int, dx: float, dy: float, others: list[tuple[float, float, float]]) -> bool:
        """Whether a step [m] leads into nothing and nobody."""
        x, y = self.xy_m[one].tolist()
        clear = self.floor.clearance(x + dx, y + dy)[0]
        if clear < self.radius_m[one] and clear <= self.floor.clearance(x, y)[0]:
            return False
        if len(self.doors) and self.doors.touches(self.xy_m[one], self.xy_m[one] + (dx, dy), float(self.radius_m[one])):
            return False
        for other_x, other_y, apart in others:
            after = math.hypot(other_x - x - dx, other_y - y - dy)
            if after < apart and after < math.hypot(other_x - x, other_y - y):
                return False
        return True


def _far_ahead(xy_m: Float[np.ndarray, "2"], yaw_rad: float) -> Float[np.ndarray, "1 2"]:
    return xy_m[None] + _FAR_M * np.array([math.cos(yaw_rad), math.sin(yaw_rad)])
