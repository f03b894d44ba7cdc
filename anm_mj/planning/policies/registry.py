"""Policies by name, with what each needs.

Other packages add policies by an entry point of the group ``anm_mj.policies``, a :class:`PolicyEntry` each; so does the
oracle, which knows the true scene. A policy of the user's own needs no entry; its name is ``module:Class``. The class
is made from a
:class:`~anm_mj.planning.policies.context.PolicyContext`, has the methods of :class:`~anm_mj.protocols.Policy`, and may
carry a frozen dataclass ``Config`` with its settings.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import logging
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anm_mj.errors import AnmError, InstallError, PlanError
from anm_mj.utils.close_names import close_name

if TYPE_CHECKING:
    from anm_mj.planning.policies.context import PolicyContext
    from anm_mj.protocols import Policy

_logger = logging.getLogger(__name__)

DEFAULT_POLICY = "gvg"
GOALS = ("coverage", "reconstruction", "both")
"""What a run is for: to see all surface; to know it well; first the one, then the other."""
DEFAULT_GOAL = "both"
ENTRY_POINTS = "anm_mj.policies"
"""Group of the entry points that name policies of other packages."""
METHODS = ("observe", "plan", "on_collision")
"""What every policy can do."""


@dataclass(frozen=True)
class PolicyEntry:
    """Where a policy is defined and what it needs."""

    path: str
    """``module:Class``; imported when the policy is asked for."""
    summary: str = ""
    """A few words for the help text."""
    defaults: Mapping[str, Any] = field(default_factory=dict)
    """Settings that differ from the defaults of the class's ``Config``."""
    mapping_preset: str | None = None
    """The only mapping preset that the policy works with; None = any."""
    uncertainty_preset: str | None = None
    """The mapping preset whose uncertainty guides the policy, whatever preset the rest comes from; None = the same."""
    needs_truth: bool = False
    """Whether the policy is told the true scene."""
    asks_map: bool = True
    """Whether the policy asks the neural map anything."""


_OWN: Mapping[str, PolicyEntry] = {
    "gvg": PolicyEntry("anm_mj.planning.policies.gvg.gvg_policy:Gvg", "ours"),
    "anm-s": PolicyEntry("anm_mj.planning.policies.anm_s.anm_s_policy:AnmS", "the paper's", uncertainty_preset="paper"),
    "anm": PolicyEntry(
        "anm_mj.planning.policies.anm.anm_policy:Anm", "with a map of its own kind", mapping_preset="anm"
    ),
    "upen": PolicyEntry("anm_mj.planning.policies.upen.upen_policy:Upen", asks_map=False),
    "frontier": PolicyEntry("anm_mj.planning.policies.frontier.frontier_policy:Frontier", asks_map=False),
    "frontier-full": PolicyEntry(
        "anm_mj.planning.policies.frontier.frontier_policy:Frontier", defaults={"range_m": 10.0}, asks_map=False
    ),
    "random": PolicyEntry("anm_mj.planning.policies.random_walk:RandomWalk", asks_map=False),
}


@functools.cache
def policies() -> Mapping[str, PolicyEntry]:
    """All policies that have a name, those of other packages last; the log tells which of theirs cannot be used."""
    found = dict(_OWN)
    for point in entry_points(group=ENTRY_POINTS):
        # What another package got wrong must not keep anybody from the policies that work.
        try:
            entry = point.load()
        except (Exception, SystemExit) as err:
            _logger.warning("Policy '%s' is left out: %s cannot be loaded (%s).", point.name, point.value, _said(err))
            continue
        if isinstance(entry, PolicyEntry):
            found[point.name] = entry
        else:
            _logger.warning("Policy '%s' is left out: %s is no PolicyEntry.", point.name, point.value)
    return found


def policy_entry(name: str) -> PolicyEntry:
    """The entry of a policy, or one without needs for ``module:Class``. Raises PlanError if the name is neither."""
    # Reading the entry points takes longer than most commands that name one of these.
    if name in _OWN:
        return _OWN[name]
    if name in policies():
        return policies()[name]
    if ":" not in name:
        raise PlanError(
            f"Unknown policy '{name}'{close_name(name, policies())}; use one of {', '.join(policies())}, or "
            "module:Class for your own."
        )
    return PolicyEntry(name)


def needs_truth(name: str) -> bool:
    """Whether a policy is told the true scene; False for names that this version does not know."""
    return name in policies() and policies()[name].needs_truth


def policy_class(name: str) -> Any:
    """The class of a policy, by a key of :func:`policies` or ``module:Class``. Raises PlanError if the name is unknown,
    or the module or class cannot be found or lacks a method, and InstallError if the package itself lacks a part.
    """
    module_name, _, class_name = policy_entry(name).path.partition(":")
    try:
        module = importlib.import_module(module_name)
    except InstallError:
        raise
    # A module of the user's own may raise anything while it is imported.
    except (Exception, SystemExit) as err:
        stem = module_name.removesuffix(".py").rpartition("/")[2]
        hint = (
            f"; write {stem}:{class_name}, with the file in the current folder" if module_name.endswith(".py") else ""
        )
        raise PlanError(f"Policy '{name}': module '{module_name}' cannot be imported ({_said(err)}){hint}.") from err
    found = getattr(module, class_name, None)
    if found is None:
        # A package that is installed comes before a file of the same name.
        place = f" ({module.__file__})" if getattr(module, "__file__", None) else ""
        raise PlanError(f"Policy '{name}': module '{module_name}'{place} has no class '{class_name}'.")
    missing = [method for method in METHODS if not callable(getattr(found, method, None))]
    if missing:
        raise PlanError(f"Policy '{name}' lacks the method(s) {', '.join(missing)} that every policy has.")
    return found


def policy_hash(name: str) -> str:
    """SHA-256 of the module that holds a policy of the user's own, as it is now; empty for one of this package, and for
    a module without a file. Modules that it imports do not count. Raises as :func:`policy_class`.
    """
    module = policy_class(name).__module__
    if module.partition(".")[0] == __name__.partition(".")[0]:
        return ""
    file = getattr(sys.modules.get(module), "__file__", None) or ""
    return hashlib.sha256(Path(file).read_bytes()).hexdigest() if os.path.isfile(file) else ""


def default_settings(name: str) -> Any:
    """The settings of a policy where nothing else is asked for: an instance of its class's ``Config``. Raises PlanError
    if there is no such policy.
    """
    from anm_mj.planning.policies.context import PolicyConfig  # Names alone should not cost the import of numpy.

    config = getattr(policy_class(name), "Config", PolicyConfig)
    try:
        return config(**policy_entry(name).defaults)
    except AnmError:
        raise
    except (Exception, SystemExit) as err:
        raise PlanError(
            f"Policy '{name}': its Config cannot be made without arguments ({err}); give every field a default."
        ) from err


def make_policy(name: str, context: PolicyContext[Any]) -> Policy:
    """A policy by its name. Raises PlanError if there is no such policy or goal, or its class cannot be made from a
    context.
    """
    goal = context.goal
    if goal not in GOALS:
        raise PlanError(f"There is no goal '{goal}'{close_name(str(goal), GOALS)}; choose one of {', '.join(GOALS)}.")
    made = policy_class(name)
    try:
        return made(context)
    except AnmError:
        raise
    except (Exception, SystemExit) as err:
        raise PlanError(f"Policy '{name}' cannot be made from a PolicyContext: {_said(err)}.") from err


def _said(err: BaseException) -> str:
    return f"{type(err).__name__}: {' '.join(str(err).split())}"
