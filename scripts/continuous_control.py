"""Explores by velocities instead of discrete actions: pure pursuit of a policy's paths, look-at for its headings.

    python scripts/continuous_control.py home --steps 200 --drive physics

The budget counts the driven distance and the turned angle in units of a forward step and of a turn; the map gets one
observation per unit. The controller (anm_mj/control/pure_pursuit.py) uses the robot's ``drive`` and ``look_at`` only,
so your own controller, or a real robot, can replace it.
"""

import math
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from anm_mj.config import make_config
from anm_mj.control.pure_pursuit import Pursuit
from anm_mj.evaluation.completion_curve import CompletionCurve
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.ground_truth.reduced_depth import reduce_depth
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import make_policy
from anm_mj.protocols import Policy
from anm_mj.scene.folder import load_scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.types import TURN_STEP_RAD, Action, MotionResult, Observation, Plan, StopReason, Twist

if TYPE_CHECKING:
    from anm_mj.sim.sim_robot import SimRobot

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
    tyro.cli(main)
