"""One run of a comparison: the configuration of a run, and which scene, start and budgets it belongs to."""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from anm_mj.config import MOST_STEPS, RunConfig, make_config
from anm_mj.io.run_shapes import Count, Number
from anm_mj.planning.policies.registry import policy_entry
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.sim.simulation_config import IDEAL, REALITIES
from anm_mj.utils.files import file_name

CONDITIONS: dict[str, str] = {
    "reality": RunConfig.reality,
    "preset": RunConfig.preset,
    "robot": RunConfig.robot,
    "drive": RunConfig.drive,
    "pose": RunConfig.pose,
    "sensor": SensorConfig.name,
    "goal": RunConfig.goal,
}
"""Options of a run that a comparison varies beside policy and settings, and their defaults, which variant names leave
out."""
PLATFORM = ("reality", "robot", "drive", "pose", "sensor")
"""Conditions in which runs agree where two policies are compared."""
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
    start: Count
    """Index among the scene's start poses."""
    start_pose: tuple[Number, Number, Number]
    """x [m], y [m], yaw [deg]."""
    seed: int
    steps: Annotated[int, Meta(ge=1, le=MOST_STEPS)]
    preset: str = CONDITIONS["preset"]
    settings: tuple[str, ...] = ()
    """Settings as given to ``--set``."""
    sensor: str = CONDITIONS["sensor"]
    """Name of the sensor whose errors are simulated."""
    robot: str = CONDITIONS["robot"]
    """Name of a builtin robot, or its MJCF file."""
    drive: str = CONDITIONS["drive"]
    pose: str = CONDITIONS["pose"]
    reality: str = CONDITIONS["reality"]
    """The world that its conditions and settings began with, which they hold."""
    goal: str = CONDITIONS["goal"]
    """What the run is for: coverage, reconstruction, or both in this order."""
    views: bool = True
    """Whether the finished map is judged by novel and by fixed views."""
    maps: bool = True
    """Whether a map is trained for a policy that asks it nothing, too."""
    robot_hash: str = ""
    """Of the robot's file, where it is none of the catalogue's."""
    policy_hash: str = ""
    """Of the module of a policy of the user's own, ``module:Class``."""
    cuts: tuple[tuple[str, Count], ...] = ()
    """Budgets by name that the tables cut the run at [steps]; empty = none but ``steps``."""

    @property
    def name(self) -> str:
        """A readable folder name, unique to the job's content."""
        # The path of a scene does not affect the run; options that were added later leave the names of others alone.
        late = {field.name: field.default for field in fields(self) if field.name not in ("preset", "settings")}
        facts = {key: value for key, value in self.facts.items() if key != "scene" and late.get(key) != value}
        digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:8]
        text = f"{self.scene_name}_{self.policy}_start{self.start}_seed{self.seed}"
        return f"{file_name(text)}_{digest}"

    @property
    def facts(self) -> dict[str, Any]:
        """Its fields without the folders of this machine, which are private; hashes identify what differs."""
        return {**asdict(self), "scene": self.scene_name, "robot": Path(self.robot).name}

    @property
    def conditions(self) -> dict[str, str]:
        """Its values of ``CONDITIONS``."""
        return {key: getattr(self, key) for key in CONDITIONS}

    @property
    def variant(self) -> str:
        """Policy, with conditions and settings if these are not the defaults."""
        return variant({"policy": self.policy, **self.conditions, "settings": " ".join(self.settings)})

    @property
    def trains(self) -> bool:
        """Whether the run trains a map: where sensor or pose err, occupancy without a field would block other paths."""
        errs = any(setting.startswith("sensor.") for setting in self.settings)
        exact = self.sensor == CONDITIONS["sensor"] and self.pose == "true" and not errs
        return self.maps or not exact or policy_entry(self.policy).asks_map

    def config(self) -> RunConfig:
        """The configuration of the run. Raises ConfigError if the preset or a setting is not one there is."""
        own = {key: getattr(self, key) for key in ("scene", "policy", "steps", "seed")}
        options: dict[str, Any] = {**own, **self.conditions}
        settings = [*(() if self.trains else UNTRAINED), *self.settings]
        return make_config(settings=settings, start=self.start_pose, **options)


def variant(row: Mapping[str, Any]) -> str:
    """Name of a variant, such as ``anm-s (policy.target=random)``; its runs differ by start and seed. ``row`` is one of
    the results table: ``policy``, the keys of ``CONDITIONS``, and ``settings`` as one text.
    """
    world = REALITIES[row.get("reality") or IDEAL]
    special = [row[key] for key, usual in CONDITIONS.items() if row[key] != world.options.get(key, usual)]
    parts = [*special, *each_setting(row["settings"])]
    text = " ".join(part for part in parts if part not in world.texts)
    return f"{row['policy']} ({text})" if text else row["policy"]


def each_setting(text: str) -> list[str]:
    """The settings of a text, as the results table has them; values may hold spaces."""
    return [setting for setting in re.split(r" (?=[\w.]+=)", text) if setting]
