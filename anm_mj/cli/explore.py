"""``anm-mj explore``: one run."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from anm_mj.cli.command_line import Option, Report, arguments
from anm_mj.cli.option_types import NewFolder, Port, Settings, policy_names, refuse_idle, run_fields
from anm_mj.errors import ConfigError
from anm_mj.sim.sensors.sensor_config import SENSORS
from anm_mj.utils.own_modules import let_import_from

if TYPE_CHECKING:
    from anm_mj.config import RunConfig
    from anm_mj.evaluation.metrics import Metrics
    from anm_mj.io.run_folder import RunFolder

RUN_FAILED = 2
"""Exit status of a run that a fault of its policy, its map or its camera has ended; its files are complete."""


def run_config(
    scene: str,
    *,
    sensor: Annotated[str | None, Option(names=lambda: SENSORS)] = None,
    target: Annotated[str | None, Option("NAME")] = None,
    no_visibility_guidance: bool = False,
    no_bootstrap: bool = False,
    keep_images: bool = False,
    people: Annotated[int | None, Option("N")] = None,
    settings: Settings = (),
    **options: Annotated[Any, run_fields(policy=policy_names)],
) -> RunConfig:
    """The configuration that the command line describes.

    Args:
        scene: name from the catalogue, a scene folder, or a file to import
        sensor: errors of the camera (exact by default), in detail by --set sensor.NAME=VALUE
        target: how policy anm-s chooses a vertex: hierarchical, best-anchored or random (policy.target=NAME)
        no_visibility_guidance: policy anm-s neither prefers nor turns to regions (policy.visibility_guidance=false)
        no_bootstrap: no rotation before the first decision (policy.bootstrap_turns=0)
        people: number of people who walk through the scene (people.number=N)
        keep_images: keep the colour images at full size, for NeRF, splats and COLMAP (record.images=full)
        settings: any setting of config.json, as in planning.margin_m=0.06 [m] or, of the policy, policy.replan_steps=8;
            may be repeated
        **options: fields of ``RunConfig``

    Raises:
        AnmError: the scene cannot be imported, or an option or setting cannot have its value.
    """
    from anm_mj.config import DEFAULT_PRESET, make_config
    from anm_mj.scene.importing.import_on_demand import folder_of
    from anm_mj.sim.gl import select_backend

    # A MuJoCo world is compiled before the run begins, and the back-end must be chosen before that.
    if not os.path.isdir(scene):
        select_backend()
    short = {
        f"policy.target={target}": target is not None,
        "policy.visibility_guidance=false": no_visibility_guidance,
        "policy.bootstrap_turns=0": no_bootstrap,
        "record.images=full": keep_images,
        f"people.number={people}": people is not None,
    }
    settings = [*(setting for setting, given in short.items() if given), *settings]
    preset = options.pop("preset", DEFAULT_PRESET)
    return make_config(preset, settings, scene=folder_of(scene), sensor=sensor, **options)


def explore(
    scene: str | None = None,
    *,
    resume: Annotated[Path | None, Option("RUN")] = None,
    out: NewFolder | None = None,
    view: bool = False,
    port: Port | None = None,
    verbose: bool = False,
    **setup: Annotated[Any, run_config],
) -> Report:
    """Let the robot explore a scene and write a run folder.

    Example: anm-mj explore home --steps 500

    Args:
        scene: name from the catalogue (anm-mj scene list), a scene folder, or a file to import
        resume: go on with a run that was killed or interrupted, from its folder; takes no scene and no settings
        out: run folder; by default a new one in runs/
        view: show the run in the browser, on this machine only
        port: port of --view; by default the next free one from 7000
        verbose: show details
        **setup: options of a run that begins
    """
    let_import_from([os.getcwd()])
    if not view:
        refuse_idle({"--port": port}, "nothing is shown; add --view")
    if resume is not None:
        from anm_mj.resume import resume as resume_run

        policy = setup.pop("policy", None)
        refuse_beside_resume(explore, {"scene": scene, "out": out, **setup})
        title = resume.resolve().name
        start = functools.partial(resume_run, resume, policy=policy)
    else:
        if scene is None:
            raise ConfigError("No scene is named; give one of anm-mj scene list, a scene folder, or --resume RUN.")
        config = run_config(scene, **setup)
        from anm_mj.run import run

        title = f"{Path(scene).name}, {config.policy}, seed {config.seed}"
        start = functools.partial(run, config, out=out)
    return show_run(start, title if view else None, port, verbose=verbose)


def refuse_beside_resume(command: Callable[..., Any], given: Mapping[str, Any]) -> None:
    """Raises ConfigError for whatever was given to a command beside ``--resume``, by the names of its arguments."""
    flags = {one.name: one.flag for one in arguments(command)}
    for name, value in given.items():
        if value is not None:
            what = flags[name] or f"the {name}"
            raise ConfigError(f"--resume goes on with the run as it was set up; leave out {what}.")


def show_run(
    start: Callable[..., tuple[RunFolder, Metrics]],
    title: str | None = None,
    port: int | None = None,
    *,
    verbose: bool,
    live: bool = False,
) -> Report:
    """Make the run, given its observers, show how it goes, with details if ``verbose``, and print the metrics at the
    end. ``title`` and ``port`` are those of the page in the browser; without a title there is none. A ``live`` run also
    takes a function that says whether the user wants an end.
    """
    from anm_mj.cli.console import PlainConsole, log_to
    from anm_mj.cli.progress import Interrupt, ProgressLine, live_view
    from anm_mj.cli.run_summary import report_metrics
    from anm_mj.io.read_run import read_json
    from anm_mj.run import resume_command
    from anm_mj.types import StopReason

    console = PlainConsole()
    if console.is_terminal:
        log_to(console, verbose=verbose)  # The live line makes room for what its own console prints.
    with (
        Interrupt(console) as interrupt,
        live_view(title, port, interrupt) as views,
        ProgressLine(console, details=verbose) as line,
    ):
        waits = {"is_over": lambda: interrupt.is_requested} if live else {}
        folder, metrics = start(observers=[interrupt, line, *views], **waits)
    failed = metrics.stop_reason in (StopReason.POLICY_ERROR, StopReason.MAP_ERROR, StopReason.SENSOR_FAULT)
    report = report_metrics(console, metrics, folder.path, RUN_FAILED if failed else 0)
    if metrics.stop_reason == StopReason.INTERRUPTED and any(folder.checkpoints.glob("*.checkpoint")):
        policy = read_json(folder.config)["policy"]
        console.say(f"Resume: {resume_command(folder.path, policy, 'drive' if live else 'explore')}")
    return report
