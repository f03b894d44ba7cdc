"""``anm-mj drive``: one run on a robot that speaks ROS 2."""

import functools
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from anm_mj.cli.command_line import Option, Report
from anm_mj.cli.explore import refuse_beside_resume, show_run
from anm_mj.cli.map import topics_by_role
from anm_mj.cli.option_types import Count, NewFolder, Settings, policy_names, run_fields
from anm_mj.errors import ConfigError
from anm_mj.utils.own_modules import let_import_from

_ROLES = {"colour", "depth", "camera", "odometry", "command"}
_POLICIES = functools.partial(policy_names, has_truth=False)
_FIELDS = run_fields("goal", "seed", "device", "preset", "return_to_start", "policy", policy=_POLICIES)


def drive(
    *,
    resume: Annotated[Path | None, Option("RUN")] = None,
    out: NewFolder | None = None,
    namespace: Annotated[str, Option("NAME")] = "",
    topic: Annotated[Sequence[str], Option("ROLE=NAME")] = (),
    steps: Count | None = None,
    pose: Literal["odometry", "slam"] | None = None,
    dry: bool = False,
    wait: bool = False,
    settings: Settings = (),
    verbose: bool = False,
    **options: Annotated[Any, _FIELDS],
) -> Report:
    """Explore with a robot that speaks ROS 2, without an installation of ROS, and write a run folder.

    Example: anm-mj drive --topic depth=/camera/aligned_depth_to_color/image_raw

    Args:
        resume: go on with a run that was killed or interrupted, from its folder; takes no settings
        out: run folder; by default a new one in runs/
        namespace: of the robot's topics (ros.namespace)
        topic: topic for colour, depth, camera, odometry or command, where several fit; may be repeated
        steps: budget of discrete actions, turns included (default: 2000)
        pose: slam (the default) corrects the odometry by localisation in the map
        dry: do not drive: only map, and show what would be done
        wait: begin at the command start on explore/command
        settings: any setting of config.json, those of the robot too (ros.NAME); may be repeated
        verbose: show details
        **options: fields of ``RunConfig``

    Raises:
        AnmError: an option cannot have its value, or the robot cannot be used.
    """
    from anm_mj.config import DEFAULT_PRESET, make_config
    from anm_mj.ros.drive import LIVE, STEPS, go_on
    from anm_mj.ros.drive import drive as drive_robot
    from anm_mj.ros.drive_config import DriveConfig

    let_import_from([os.getcwd()])
    if resume is not None:
        policy = options.pop("policy", None)
        own = {"out": out, "namespace": namespace or None, "topic": topic or None, "steps": steps, "pose": pose}
        refuse_beside_resume(drive, {**own, "dry": dry or None, "settings": settings or None, **options})
        return show_run(functools.partial(go_on, resume, policy=policy, waits=wait), verbose=verbose, live=True)
    topics = topics_by_role(topic)
    if strange := sorted(topics.keys() - _ROLES):
        raise ConfigError(f"--topic {strange[0]}=... names no role; give one of {', '.join(sorted(_ROLES))}.")
    named = [f"ros.{role}={name}" for role, name in topics.items()] + ([f"ros.namespace={namespace}"] * bool(namespace))
    config = make_config(
        options.pop("preset", DEFAULT_PRESET),
        [*named, *settings],
        kind=DriveConfig,
        scene=LIVE,
        pose=pose or "slam",
        steps=STEPS if steps is None else steps,
        dry=dry,
        **options,
    )
    return show_run(functools.partial(drive_robot, config, out=out, waits=wait), verbose=verbose, live=True)
