"""Keeps a faulty policy from ending a run without its files: what it raises or returns wrongly becomes a stop."""

import logging
import operator
import reprlib
import traceback
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from anm_mj.control.path_follower import Follower
from anm_mj.errors import AnmError, PlanError
from anm_mj.geometry.triangles import FARTHEST_M
from anm_mj.protocols import Continues, Mapper, Policy
from anm_mj.types import (
    Action,
    Candidate,
    ExploredState,
    Observation,
    Plan,
    Pose2,
    Region,
    StopReason,
    TargetOutcome,
    TopDownMap,
    UnexploredPatch,
    VoronoiGraph,
)

_logger = logging.getLogger(__name__)

_PARTS = {"topdown": TopDownMap, "graph": VoronoiGraph, "closed": TargetOutcome}
"""Fields of a plan that hold one thing or none."""
_TUPLES = {"regions": Region, "candidates": Candidate, "unexplored": UnexploredPatch}
"""Fields of a plan that hold some things."""


class GuardedPolicy:
    """A policy whose first fault becomes a plan that stops the run with ``POLICY_ERROR``.

    Errors that the map or the robot raise within a policy pass through: they are not the policy's.
    """

    REBUILT = ("_outcome",)

    def __init__(self, policy: Policy, name: str, outcome: str = "The run ends") -> None:
        """Guard ``policy``; sentences call it ``name``, and say what its fault leads to by ``outcome``."""
        self._policy = policy
        self._name = name
        self._outcome = outcome
        self._fault: str | None = None

    @property
    def has_failed(self) -> bool:
        """Whether it has had a fault, and is not asked any more."""
        return self._fault is not None

    def memory(self) -> dict[str, np.ndarray]:
        """What the policy has found out beside the map, as far as it is arrays of numbers; nothing where it does not
        say, or has failed.
        """
        found = self._call("memory", None, self._policy.memory) if isinstance(self._policy, Continues) else None
        if not isinstance(found, dict):
            return {}
        return {str(name): value for name, value in found.items() if _is_storable(value)}

    def continue_from(self, prior: ExploredState, mapper: Mapper) -> None:
        """Let the policy take over a prior run, if it can; a fault shows at the first decision."""
        if isinstance(self._policy, Continues):
            self._call("continue_from", None, self._policy.continue_from, prior, mapper)
        else:
            _logger.info("Policy %s knows the prior run through the map alone.", self._name)

    def observe(self, observation: Observation) -> None:
        """Take in an observation; a fault shows at the next decision."""
        self._call("observe", observation.step, self._policy.observe, observation)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The policy's decision, or the stop that its fault leads to."""
        plan = self._call("plan", observation.step, self._policy.plan, mapper, observation)
        if self._fault is None:
            wrong = plan_fault(plan, observation.pose)
            if wrong is None:
                return plan
            self._note(f"returned a plan at step {observation.step} that cannot be executed: {wrong}")
        assert self._fault is not None
        return Plan(self._fault, stop=StopReason.POLICY_ERROR)

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Pass on a collision; a fault shows at the next decision."""
        self._call("on_collision", None, self._policy.on_collision, pose, action)

    def _call(self, method: str, step: int | None, function: Callable[..., Any], *arguments: Any) -> Any:
        if self._fault is not None:
            return None
        try:
            return function(*arguments)
        except KeyboardInterrupt:
            raise
        # Also what calls sys.exit(), or the run would end as if all were well, and what is no Exception.
        except BaseException as err:
            if isinstance(err, AnmError) and not isinstance(err, PlanError):
                raise
            _logger.debug("The error of policy %s:", self._name, exc_info=True)
            at = "" if step is None else f" at step {step}"
            self._note(f"failed in {method}{at}: {describe_error(err)}")
            return None

    def _note(self, what: str) -> None:
        self._fault = f"policy {self._name} {what}"
        _logger.error("%s because %s.", self._outcome, self._fault)


def describe_error(err: BaseException) -> str:
    """Type and message of an error, and the line that raised it."""
    said = " ".join(str(err).split())
    frames = traceback.extract_tb(err.__traceback__)
    where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{type(err).__name__}{f': {said}' if said else ''}{where}"


def plan_fault(plan: Any, pose: Pose2) -> str | None:
    """What is wrong with something that a policy returned; None if it is a plan that can be executed from a pose."""
    if not isinstance(plan, Plan):
        return f"it is {'nothing' if plan is None else f'of type {type(plan).__name__}'}, not an anm_mj.types.Plan"
    if not isinstance(plan.reason, str):
        return f"reason is {reprlib.repr(plan.reason)}, not a text"
    wrong = _logged_fault(plan)
    if wrong is not None:
        return wrong
    if plan.stop is not None:
        return None if isinstance(plan.stop, StopReason) else f"stop is {reprlib.repr(plan.stop)}, not a StopReason"
    path = plan.path_xy_m
    if not isinstance(path, np.ndarray):
        return f"path_xy_m is of type {type(path).__name__}, not an array"
    if path.dtype.kind not in "fiu" or path.ndim != 2 or path.shape[1] != 2:
        return f"path_xy_m has shape {path.shape} and type {path.dtype}, not (k, 2) and numbers"
    if not (np.abs(path) <= FARTHEST_M).all():
        return f"path_xy_m holds places that are not finite, or farther than {FARTHEST_M:g} m"
    try:
        finite = isinstance(plan.headings_rad, (tuple, list)) and bool(
            np.isfinite([*map(float, plan.headings_rad)]).all()
        )
    except (TypeError, ValueError):
        finite = False
    if not finite:
        return f"headings_rad is {reprlib.repr(plan.headings_rad)}, not a tuple of finite numbers [rad]"
    moves = set(Action) - {Action.STOP}
    known = isinstance(plan.actions, (tuple, list)) and all(isinstance(own, Action) for own in plan.actions)
    if not known or not moves.issuperset(plan.actions):
        return (
            f"actions is {reprlib.repr(plan.actions)}; they must be moves and turns, and a stop is a StopReason in stop"
        )
    if not _is_count(plan.valid_steps):
        return f"valid_steps is {reprlib.repr(plan.valid_steps)}, not a whole number from 0 up"
    follower = Follower()
    follower.start(plan)
    if follower.next_action(pose) is None:
        return (
            "it asks for nothing: the path ends where the robot stands, it looks along all headings already, and there "
            "are no actions and no stop"
        )
    return None


def _logged_fault(plan: Plan) -> str | None:
    """What is wrong with the fields that logs and films show; None if they can be written."""
    for name, kind in _PARTS.items():
        part = getattr(plan, name)
        if part is None:
            continue
        if not isinstance(part, kind):
            return f"{name} is of type {type(part).__name__}, not an anm_mj.types.{kind.__name__}"
        for field in fields(part):
            if isinstance(getattr(part, field.name), (tuple, list)):
                return f"{name}.{field.name} is of type {type(getattr(part, field.name)).__name__}, not an array"
    for name, kind in _TUPLES.items():
        some = getattr(plan, name)
        if not isinstance(some, (tuple, list)) or not all(isinstance(each, kind) for each in some):
            return f"{name} is {reprlib.repr(some)}, not a tuple of anm_mj.types.{kind.__name__}"
    for region in plan.regions:
        try:
            others = [*region.normal, region.num_members, region.score, region.vertex]
            numbers = np.array([*region.centre_m, *others], float)
        except (TypeError, ValueError):
            numbers = np.zeros(0)
        # The scale of scores is the policy's own.
        if numbers.shape != (9,) or not np.isfinite(numbers).all() or np.abs(numbers[:3]).max() > FARTHEST_M:
            return f"regions holds {reprlib.repr(region)}, not a place and a normal of three numbers each, and numbers"
    if plan.topdown is not None and not isinstance(plan.topdown.resolution_m, int | float | np.number):
        return f"topdown.resolution_m is {reprlib.repr(plan.topdown.resolution_m)}, not a number of metres"
    if not isinstance(plan.stage_ms, dict):
        return f"stage_ms is {reprlib.repr(plan.stage_ms)}, not milliseconds by the name of a stage"
    return None


def _is_storable(value: Any) -> bool:
    """Whether a value is an array that the file of a prior run can hold."""
    return isinstance(value, np.ndarray) and value.dtype.kind in "bfiu" and value.dtype.itemsize <= 8


def _is_count(value: Any) -> bool:
    """Whether a value is a whole number from 0 up, of Python or of NumPy."""
    try:
        return operator.index(value) >= 0
    except TypeError:
        return False
