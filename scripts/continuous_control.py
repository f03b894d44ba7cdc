"""Explores by velocities instead of discrete actions: pure pursuit of a policy's paths, look-at for its headings.

    python scripts/continuous_control.py home --steps 200 --drive physics

The budget counts the driven distance and the turned angle in units of a forward step and of a turn; the map gets one
observation per unit. The controller uses the robot's ``drive`` and ``look_at`` only, so your own
controller, or a real robot, can replace it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro
from jaxtyping import Float

from anm_mj.cli.command_line import run_script
from anm_mj.config import make_config
from anm_mj.evaluation.completion_curve import CompletionCurve
from anm_mj.frames import wrap_angle
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.ground_truth.reduced_depth import reduce_depth
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import make_policy
from anm_mj.protocols import Policy
from anm_mj.scene.folder import load_scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.types import ARRIVED_M, TURN_STEP_RAD, Action, MotionResult, Observation, Plan, Pose2, StopReason, Twist

if TYPE_CHECKING:
    from anm_mj.sim.sim_robot import SimRobot

LOOKAHEAD_M = 0.25
"""Distance from the robot to the pursued point of the path [m]."""
TURN_FIRST_RAD = math.radians(35.0)
"""Larger heading errors cause a turn on the spot first [rad]."""
SPEED_MPS = 0.4
"""Forward speed [m/s]; lower in tight curves."""
TURN_RADPS = 1.2
"""Turn rate on the spot, and the highest one while driving [rad/s]."""


class Pursuit:
    """Follows a polyline to its end.

    Source: Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU-RI-TR-92-01, 1992.
    """

    def __init__(self, path_xy_m: Float[np.ndarray, "k 2"]):
        """Start at the path's first point; it has two points or more, world [m]."""
        self._points = path_xy_m
        self._leg = 0

    def twist(self, pose: Pose2) -> Twist | None:
        """The velocity at a pose; None at the end of the path."""
        if math.dist(self._points[-1], pose.xy_m) < ARRIVED_M:
            return None
        ahead = self._pursued(pose.xy_m) - pose.xy_m
        error_rad = wrap_angle(math.atan2(ahead[1], ahead[0]) - pose.yaw_rad)
        if abs(error_rad) > TURN_FIRST_RAD:
            return Twist(0.0, math.copysign(TURN_RADPS, error_rad))
        curvature = 2.0 * math.sin(error_rad) / max(float(np.linalg.norm(ahead)), 0.05)
        speed_mps = min(SPEED_MPS, TURN_RADPS / max(abs(curvature), 1e-9))
        return Twist(speed_mps, speed_mps * curvature)

    def _pursued(self, xy_m: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """The first point of the path at the lookahead distance, from the present segment on."""
        for leg in range(self._leg, len(self._points) - 1):
            start, end = self._points[leg], self._points[leg + 1]
            if math.dist(end, xy_m) > LOOKAHEAD_M:
                self._leg = leg
                return _at_distance(start, end, xy_m)
        return self._points[-1]


def _at_distance(
    start: Float[np.ndarray, "2"], end: Float[np.ndarray, "2"], xy_m: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "2"]:
    """Where a segment leaves the lookahead circle about a place; outside of the circle, its nearest point."""
    along, from_place = end - start, start - xy_m
    a, b = float(along @ along), float(from_place @ along)
    c = float(from_place @ from_place) - LOOKAHEAD_M**2
    root = b * b - a * c
    t = (-b + math.sqrt(root)) / a if root > 0.0 else -b / a
    return start + float(np.clip(t, 0.0, 1.0)) * along


PERIOD_S = 0.1
"""Time between two velocities [s]."""
LOOK_M = 2.0
"""Distance of the look-at point for a heading [m]."""


class Budget:
    """Counts motion in units of discrete actions and observes once per unit."""

    def __init__(self, robot: "SimRobot", mapper: NeuralMap, policy: Policy, truth: GroundTruth, steps: int):
        self.robot, self.mapper, self.policy = robot, mapper, policy
        self.curve, self.steps = CompletionCurve(truth), steps
        self.spent, self.collisions, self._frames = 0.0, 0, 0
        self.fault: StopReason | None = None
        self.observation = self.perceive()

    def perceive(self) -> Observation:
        """Observe, integrate into the map, and update the completion."""
        seen = self.robot.observe()
        self.mapper.integrate(seen)
        self.policy.observe(seen)
        self.curve.frame(self._frames, reduce_depth(seen.depth_m), seen.intrinsics, seen.T_world_camera, seen.pose)
        self._frames += 1
        self.observation = seen
        return seen

    def pay(self, result: MotionResult) -> None:
        """Charge a motion to the budget."""
        before = math.floor(self.spent)
        # Like a refused action, a refused motion costs a unit.
        self.spent += max(result.equivalent_steps, float(result.collided))
        self.collisions += result.collided
        self.fault = self.fault or result.fault
        if math.floor(self.spent) > before:
            self.perceive()

    @property
    def left(self) -> bool:
        """Whether budget is left, and the robot can drive."""
        return self.spent < self.steps and self.fault is None


def main(
    scene: Annotated[str, tyro.conf.Positional] = "home",
    steps: int = 200,
    drive: str = "physics",
    policy: str = "gvg",
    image_px: int = 256,
    seed: int = 0,
) -> None:
    """Explore continuously and print the completion.

    Args:
        scene: name or folder of a scene.
        steps: budget, in units of discrete actions.
        drive: kinematic or physics.
        policy: chooses the targets.
        image_px: width and height of the images [px].
        seed: of map and policy.
    """
    config = make_config("quick", [], scene=scene, policy=policy, drive=drive, seed=seed)
    world = load_scene(scene)
    with make_robot(world, drive=drive, image_px=image_px) as robot:
        mapper = NeuralMap(config.mapping, seed=seed, device="cpu")
        planner = make_policy(policy, PolicyContext(robot.footprint, config.policy_settings, config.planning, seed))
        budget = Budget(robot, mapper, planner, GroundTruth.sample(*world.triangles()), steps)
        while budget.left:
            plan = planner.plan(mapper, budget.observation)
            if plan.stop is not None:
                break
            collisions = budget.collisions
            carry_out(plan, budget)
            if budget.collisions > collisions:
                planner.on_collision(budget.observation.pose, Action.MOVE_FORWARD)
        budget.curve.last()
        seen = budget.curve.rows[-1].completion_ratio
        print(
            f"{seen:.1f} % completion ratio in {budget.spent:.0f} of {steps} units, {budget.curve.path_m:.1f} m, "
            f"{robot.data.time:.0f} s, {budget.collisions} collisions."
        )
        if budget.fault is not None:
            print(f"The robot can drive no more: {budget.fault.name}.")


def carry_out(plan: Plan, budget: Budget) -> None:
    """Execute a plan until it is done, something stops the robot, or the budget is spent."""
    robot, start = budget.robot, budget.spent
    for action in plan.actions:
        if not budget.left:
            return
        turn_rad = {Action.TURN_LEFT: TURN_STEP_RAD, Action.TURN_RIGHT: -TURN_STEP_RAD}.get(action)
        if turn_rad is None:
            budget.pay(robot.drive(Twist(0.325, 0.0), 0.2))
        else:
            budget.pay(robot.look_at(ahead_of(robot, robot.pose.yaw_rad + turn_rad)))
    pursuit = Pursuit(plan.path_xy_m) if len(plan.path_xy_m) > 1 else None
    while pursuit is not None and budget.left:
        twist = pursuit.twist(robot.pose)
        if twist is None:
            break
        result = robot.drive(twist, PERIOD_S)
        budget.pay(result)
        if not budget.left or result.collided or (plan.valid_steps and budget.spent - start > plan.valid_steps):
            return
    for heading_rad in plan.headings_rad:
        if not budget.left:
            return
        budget.pay(robot.look_at(ahead_of(robot, heading_rad)))


def ahead_of(robot: "SimRobot", heading_rad: float) -> np.ndarray:
    """A point ahead in the direction of a heading [m]."""
    pose = robot.pose
    return np.array(
        [pose.x_m + LOOK_M * math.cos(heading_rad), pose.y_m + LOOK_M * math.sin(heading_rad), 1.0], dtype=float
    )


if __name__ == "__main__":
    run_script(main)
