"""The viewer of a run without a display (null object)."""

from __future__ import annotations

from anm_mj.protocols import Mapper
from anm_mj.types import Observation, Plan


class NullViewer:
    """Shows nothing."""

    def show(self, observation: Observation, mapper: Mapper, plan: Plan | None) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""
