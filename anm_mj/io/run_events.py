"""What a run tells beside the events of its loop (:mod:`anm_mj.events`)."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from anm_mj.protocols import Mapper
from anm_mj.types import Footprint, Observation, Plan


@runtime_checkable
class Completed(Protocol):
    """How complete a run is."""

    @property
    def step(self) -> int:
        """The step of the figures."""
        ...

    @property
    def completion_ratio(self) -> float:
        """Share of all surface that was seen to 5 cm [%]."""
        ...

    @property
    def observable_ratio(self) -> float | None:
        """The same of the surface that can be seen; None where that is not known [%]."""
        ...


def headline(row: Completed) -> tuple[float, str]:
    """How complete a run is [%], and of what: of the observable surface where that is known, else of all surface."""
    if row.observable_ratio is None:
        return row.completion_ratio, "the surface"
    return row.observable_ratio, "the observable surface"


@dataclass(frozen=True)
class Surveying:
    """The observable surface is searched for, once per scene and camera."""

    done: int
    total: int


@dataclass(frozen=True)
class Started:
    """The loop is about to begin, or to go on, with a budget of ``num_steps``."""

    folder: Path
    num_steps: int
    completed: Callable[[], Completed | None]
    """How complete the run is, as far as that is computed; None before the first figure."""
    footprint: Footprint | None = None
    """The space that the robot sweeps; None for a recorded sequence."""


@dataclass(frozen=True)
class Mapped:
    """A frame of a recorded sequence is in the map; ``plan`` is where the policy, if asked, would have gone."""

    observation: Observation
    mapper: Mapper
    plan: Plan | None
