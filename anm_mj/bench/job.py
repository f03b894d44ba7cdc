"""One run of a comparison."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anm_mj.planning.policies.context import DEFAULT_GOAL
from anm_mj.planning.policies.registry import policy_entry
from anm_mj.robot.robot_config import DEFAULT_ROBOT
from anm_mj.utils.files import file_name

if TYPE_CHECKING:
    from anm_mj.config import RunConfig


UNTRAINED = (
    "mapping.schedule.first_iterations=0",
    "mapping.schedule.iterations=0",
    "mapping.schedule.final_iterations=0",
    "mapping.schedule.keyframe_every=1000000",
    "mapping.geometry=occupancy",
)
"""Settings of a run that trains no map: the occupancy alone says what blocks a path."""


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
    robot: str = DEFAULT_ROBOT
    """Name of a builtin robot, or its MJCF file."""
    drive: str = "kinematic"
    pose: str = "true"
    goal: str = DEFAULT_GOAL
    """What the run is for: coverage, reconstruction, or both in this order."""
    views: bool = True
    """Whether the finished map is judged by held-out and by fixed views."""
    maps: bool = True
    """Whether a map is trained for a policy that asks it nothing, too."""
    cuts: tuple[tuple[str, int], ...] = ()
    """Budgets by name that the tables cut the run at [steps]; empty = none but ``steps``."""

    @classmethod
    def from_facts(cls, facts: Mapping[str, Any]) -> Job:
        """A job from its fields as JSON has them."""
        lists = {key: tuple(facts[key]) for key in ("start_pose", "settings")}
        cuts = tuple((name, steps) for name, steps in facts.get("cuts", ()))
        return cls(**{**facts, **lists, "cuts": cuts})

    @property
    def name(self) -> str:
        """A readable folder name, unique to the job's content."""
        # The path of a scene does not affect the run.
        facts = {key: value for key, value in self.facts.items() if key != "scene"}
        for field in fields(self):
            # Comparisons made before there was a choice go on.
            if facts.get(field.name) == field.default:
                del facts[field.name]
        digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:8]
        text = f"{self.scene_name}_{self.policy}_start{self.start}_seed{self.seed}"
        return f"{file_name(text)}_{digest}"

    @property
    def facts(self) -> dict[str, Any]:
        """Its fields without the folders of this machine, which are private; a hash identifies the scene."""
        return {**asdict(self), "scene": self.scene_name, "robot": Path(self.robot).name}

    @property
    def trains(self) -> bool:
        """Whether the run trains a map: where sensor or pose err, occupancy without a field would block other paths."""
        errs = any(setting.startswith("sensor.") for setting in self.settings)
        exact = self.sensor == "exact" and self.pose == "true" and not errs
        return self.maps or not exact or policy_entry(self.policy).asks_map

    def config(self) -> RunConfig:
        """The configuration of the run.

        Raises:
            ConfigError: The preset or a setting is not one there is.
        """
        # A worker should not wait for what only the real runs need.
        from anm_mj.config import make_config

        return make_config(
            self.preset,
            [*(() if self.trains else UNTRAINED), *self.settings],
            sensor=self.sensor,
            robot=self.robot,
            drive=self.drive,
            pose=self.pose,
            goal=self.goal,
            scene=self.scene,
            policy=self.policy,
            steps=self.steps,
            seed=self.seed,
            start=self.start_pose,
        )
