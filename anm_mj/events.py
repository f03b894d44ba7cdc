"""What the loop tells, and who listens: recorder, viewer, progress, checkpoints, a user's own function.

An observer hears every event in the order in which things happen, when the state of the run is whole (but for
:class:`Located`). It may ask for the end of the run; apart from that, nothing that the robot does depends on it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from anm_mj.localisation.localiser import PoseEstimate
from anm_mj.protocols import Mapper
from anm_mj.types import ActionResult, MapUpdate, Observation, Plan, StopReason


@dataclass(frozen=True)
class Located:
    """The pose of an observation after an action is known; the map has not learnt from it yet.

    The one event within a step: nothing is to be stored, as the state of the run is that of before.
    """

    observation: Observation


@dataclass(frozen=True)
class Observed:
    """An observation was taken into the map; the first one comes before any action."""

    observation: Observation
    """As the robot believes it: with its estimated pose, and without what the camera got wrong."""
    update: MapUpdate
    """What the map learnt from it."""
    estimate: PoseEstimate | None = None
    """What localisation says of its pose; None where poses are taken as they come."""


@dataclass(frozen=True)
class Decided:
    """The policy made a plan."""

    step: int
    """Number of actions before it."""
    plan: Plan


@dataclass(frozen=True)
class Stepped:
    """An action was executed, and what the robot saw after it was taken into the map."""

    step: int
    """Number of actions so far."""
    result: ActionResult
    """What the action did."""
    observation: Observation
    """What the robot saw after it."""
    update: MapUpdate
    """What the map learnt from that."""
    plan: Plan
    """The plan that the action belongs to."""
    mapper: Mapper
    """The map, as of now."""
    stage_ms: dict[str, float]
    """Time of each stage of this step [ms]."""
    loop_s: float
    """Time spent in the loop so far, without set-up and observers [s]."""


@dataclass(frozen=True)
class Ended:
    """The loop has come to its end."""

    stop_reason: StopReason
    num_steps: int
    """Number of actions in all."""
    loop_s: float
    """Time spent in the loop, without set-up and observers [s]."""
    observation: Observation
    """The last one."""


Event = Located | Observed | Decided | Stepped | Ended


@runtime_checkable
class Observer(Protocol):
    """Follows a run."""

    def on_event(self, event: object) -> bool | None:
        """Take an event in; ignore those of a type that it does not know. Returns True to end the run (``INTERRUPTED``)
        before its next step.
        """
        ...


class On:
    """An observer that is a function: it hears the events of one type."""

    def __init__(self, event_type: type, function: Callable[[Any], object]) -> None:
        """Hear events of a type, such as :class:`Stepped`; the run ends when the function returns True for one."""
        self._type, self._function = event_type, function

    def on_event(self, event: object) -> bool | None:
        """See :class:`Observer`."""
        if not isinstance(event, self._type):
            return False
        answer = self._function(event)
        # A comparison of arrays gives a truth value of NumPy's own.
        return isinstance(answer, bool | np.bool_) and bool(answer)
