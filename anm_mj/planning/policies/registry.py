"""Policies by name: the ones that ship with the project, or any class as ``module:Class``."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import partial

from anm_mj.errors import PlanError
from anm_mj.planning.config import PlanningConfig
from anm_mj.planning.policies.anm.policy import Anm
from anm_mj.planning.policies.anm_s.policy import AnmS
from anm_mj.planning.policies.frontier.policy import FULL_RANGE_M, Frontier
from anm_mj.planning.policies.gvg.policy import Gvg
from anm_mj.planning.policies.random_walk.policy import RandomWalk
from anm_mj.planning.policies.upen.policy import Upen
from anm_mj.protocols import Policy
from anm_mj.types import Footprint

POLICIES: dict[str, Callable[[PlanningConfig, Footprint, int], Policy]] = {
    "gvg": Gvg,
    "anm-s": AnmS,
    "anm": Anm,
    "frontier": Frontier,
    "frontier-full": partial(Frontier, range_m=FULL_RANGE_M),
    "upen": Upen,
    "random": RandomWalk,
}


def policy_class(name: str) -> Callable[[PlanningConfig, Footprint, int], Policy]:
    """What makes a policy from settings, footprint and seed.

    Args:
        name: a key of ``POLICIES``, or ``module:Class`` for one of the user's own.

    Raises:
        PlanError: the name is unknown, or the module or class cannot be found or lacks a method.
    """
    if name in POLICIES:
        return POLICIES[name]
    module_name, colon, class_name = name.partition(":")
    if not colon:
        raise PlanError(f"Unknown policy '{name}'; use one of {', '.join(POLICIES)}, or module:Class for your own.")
    try:
        module = importlib.import_module(module_name)
    except (ImportError, ValueError, TypeError) as err:
        raise PlanError(f"Policy '{name}': module '{module_name}' cannot be imported ({err}).") from err
    made = getattr(module, class_name, None)
    if made is None:
        raise PlanError(f"Policy '{name}': module '{module_name}' has no class '{class_name}'.")
    missing = [method for method in ("plan", "blocked") if not callable(getattr(made, method, None))]
    if missing:
        raise PlanError(f"Policy '{name}' lacks the method(s) {', '.join(missing)} that every policy has.")
    return made


def make_policy(
    made: Callable[[PlanningConfig, Footprint, int], Policy], config: PlanningConfig, footprint: Footprint, seed: int
) -> Policy:
    """A policy of a class that :func:`policy_class` found.

    Raises:
        PlanError: the class cannot be made from settings, footprint and seed.
    """
    try:
        return made(config, footprint, seed)
    except TypeError as err:
        raise PlanError(
            f"Policy {getattr(made, '__name__', made)} cannot be made from (config, footprint, seed): {err}."
        ) from err
