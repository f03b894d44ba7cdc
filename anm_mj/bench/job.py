"""One run of a comparison."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from anm_mj.config import RunConfig


@dataclass(frozen=True)
class Job:
    """One run and everything that determines it."""

    scene: str
    """Name or path, as given."""
    scene_name: str
    scene_hash: str
    policy: str
    start: int
    """Index among the scene's start poses."""
    start_pose: tuple[float, float, float]
    """x [m], y [m], yaw [deg]."""
    seed: int
    steps: int
    preset: str
    settings: tuple[str, ...]
    """Settings as given to ``--set``."""
    sensor: str = "exact"
    """Name of the sensor whose errors are simulated."""

    @property
    def name(self) -> str:
        """A readable folder name, unique to the job's content."""
        # The path of a scene does not affect the run.
        facts = {key: value for key, value in asdict(self).items() if key != "scene"}
        if self.sensor == "exact":
            del facts["sensor"]  # Comparisons made before there were sensors go on.
        digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:8]
        text = f"{self.scene_name}_{self.policy}_start{self.start}_seed{self.seed}"
        return "".join(c if c.isalnum() or c in "-._" else "-" for c in text) + f"_{digest}"

    def config(self) -> RunConfig:
        """The configuration of the run.

        Raises:
            ConfigError: The preset or a setting is not one there is.
        """
        # A worker should not wait for what only the real runs need.
        from anm_mj.config import make_config

        return make_config(
            self.preset,
            list(self.settings),
            sensor=self.sensor,
            scene=self.scene,
            policy=self.policy,
            steps=self.steps,
            seed=self.seed,
            start=self.start_pose,
        )
