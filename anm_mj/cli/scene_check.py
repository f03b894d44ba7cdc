"""``anm-mj scene check``: checks whether the robot can use a scene, and describes the scene."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anm_mj.cli.command_line import Report
from anm_mj.cli.option_types import NewFile, Settings, require_ending, require_read
from anm_mj.cli.scene import scene_facts
from anm_mj.robot.robot_config import DEFAULT_ROBOT

if TYPE_CHECKING:
    from anm_mj.scene.check import SceneCheck
    from anm_mj.types import Pose2

_MAX_ONE_SIDED = 0.001
"""Back-face culling is disabled where it changes more than this share of the pixels."""


def scene_check(
    scene: str, *, robot: str = DEFAULT_ROBOT, settings: Settings = (), out: NewFile | None = None
) -> Report:
    """Check whether a robot can use a scene, and draw a contact sheet. The exit status is 1 if it cannot.

    Args:
        scene: name from the catalogue or a scene folder
        robot: an MJCF file, or a name (docs/robot.md)
        settings: a setting of the robot, as in model.keyframe=stow; may be repeated
        out: contact sheet: .png, .pdf or .svg; by default SCENE_check.png in the current folder
    """
    from anm_mj.cli.console import PlainConsole, busy, say_problems
    from anm_mj.config import DEFAULT_PRESET, make_config
    from anm_mj.scene.check import check_scene, disable_backface_culling
    from anm_mj.scene.folder import load_scene
    from anm_mj.sim.footprint import footprint_of
    from anm_mj.sim.gl import select_backend

    require_ending(out, (".png", ".pdf", ".svg"))
    config = make_config(DEFAULT_PRESET, list(settings), scene=scene, robot=robot)
    require_read(settings, "model")
    world = load_scene(scene)
    backend = select_backend()
    from anm_mj.sim.scene_views import CUT_M, SceneViews
    from anm_mj.viz.scene_sheet import VIEWS, write_sheet

    console = PlainConsole()
    with busy(console, "check"):
        check = check_scene(world, footprint_of(config))
    console.say(*describe(check))
    with busy(console, "views"):
        views = SceneViews(world, backend)
        poses = _poses(check)
        backfaces = views.check_backfaces(poses)
    if backfaces is None:
        console.say("one-sided walls: not looked for, because nothing can be drawn here")
    else:
        fixed = backfaces.changed_fraction > _MAX_ONE_SIDED and disable_backface_culling(world)
        if fixed:
            world = replace(world, cull_face=False)
            views = SceneViews(world, backend)
        says = " (fixed: both sides are drawn from now on)" if fixed else ""
        drawn = "front sides are" if world.cull_face else "both sides are"
        console.say(
            f"one-sided walls: leaving out back sides would change {backfaces.changed_fraction:.2%} of the picture; "
            f"{drawn} drawn{says}",
            f"camera: {backfaces.exact_fraction:.3%} of pixels within 1 mm of an exact ray",
        )
    out = out or Path(f"{world.folder.resolve().name}_check.png")
    shown = poses[:VIEWS]
    write_sheet(check, views.top_view(), views.top_corners_m, CUT_M, views.interior_views(shown), shown, out)
    console.say(f"contact sheet: {out}")
    facts = check_facts(check) | {"views": backfaces, "sheet": out}
    return Report(facts, say_problems(check.problems))


def check_facts(check: SceneCheck) -> dict[str, Any]:
    """What ``--json`` says of a check; poses in world axes."""
    plan = check.plan
    return scene_facts(check.scene) | {
        "has_ceiling": check.scene.has_ceiling,
        "floor_m": check.floor_m,
        "footprint": check.footprint,
        "textures_px": check.texture_sizes_px,
        "navigable_m2": None if check.area is None else check.area.area_m2,
        "rooms_m2": None if plan is None else plan.area_m2,
        "doors": None if plan is None else plan.doors,
        "holes_x_y_m2": check.holes,
        "clear_starts": check.clear_starts,
        "blocked_starts": check.blocked_starts,
        "problems": check.problems,
    }


def describe(check: SceneCheck) -> list[str]:
    """One line per finding."""
    import numpy as np

    scene = check.scene
    size = scene.bounds_m[1] - scene.bounds_m[0]
    megapixels = sum(width * height for width, height in check.texture_sizes_px) / 1e6
    largest = max((max(pair) for pair in check.texture_sizes_px), default=0)
    floor = "none found" if check.floor_m is None else f"at {check.floor_m:+.3f} m"
    lines = [
        f"{scene.name}: {scene.num_triangles:,} triangles, {size[0]:.1f} x {size[1]:.1f} x {size[2]:.1f} m",
        f"textures: {len(check.texture_sizes_px)}, {megapixels:.1f} megapixels, the largest {largest} px",
        f"floor: {floor}, {'with' if scene.has_ceiling else 'no'} ceiling",
        f"robot: {check.footprint.radius_m:.2f} m in radius, {check.footprint.z_max_m:.2f} m high",
    ]
    if check.area is not None and check.plan is not None:
        cells = np.bincount(check.area.component.ravel())[1:]
        others_m2 = cells[1:].sum() * check.area.grid.resolution_m**2
        holes = ", ".join(f"{m2:.2f} m2 at ({x:g}, {y:g})" for x, y, m2 in check.holes[:5])
        lines.append(f"holes in the floor: {len(check.holes)}{f' ({holes})' if holes else ''}")
        lines.append(
            f"navigable: {check.area.area_m2:.1f} m2 in one piece"
            + (f", {others_m2:.1f} m2 in {len(cells) - 1} pieces cut off from it" if len(cells) > 1 else "")
        )
        rooms = ", ".join(f"{m2:.1f}" for m2 in check.plan.area_m2)
        known = "" if scene.rooms in (None, len(check.plan.area_m2)) else f" (the scene says {scene.rooms})"
        lines.append(f"rooms: {len(check.plan.area_m2)}{known}{f', of {rooms} m2' if rooms else ''}")
        lines.append(f"doors: {len(check.plan.doors)}")
        for door in check.plan.doors:
            fits = "the robot fits" if door.fits else "too narrow for the robot"
            lines.append(
                f"  {door.rooms[0]} - {door.rooms[1]} at ({door.xy_m[0]:.2f}, {door.xy_m[1]:.2f}): "
                f"{door.width_m:.2f} m, {fits}"
            )
    starts = ", ".join(f"({p.x_m:g}, {p.y_m:g}, {math.degrees(p.yaw_rad):g})" for p in check.clear_starts)
    lines.append(f"starts: {len(check.clear_starts)} clear{f': {starts}' if starts else ''}")
    if check.blocked_starts:
        blocked = ", ".join(f"({p.x_m:g}, {p.y_m:g})" for p in check.blocked_starts)
        lines.append(f"blocked starts: {blocked}")
    return lines


def _poses(check: SceneCheck) -> tuple[Pose2, ...]:
    """Ten camera poses: the starts, and the starts turned; without starts the middle of the scene."""
    from anm_mj.frames import move_pose
    from anm_mj.types import Pose2

    starts = check.clear_starts or check.scene.starts
    if not starts:
        x, y = check.scene.bounds_m[:, :2].mean(axis=0)
        starts = (Pose2(float(x), float(y), 0.0),)
    return tuple(move_pose(starts[i % len(starts)], 0.0, math.radians(75.0) * (i // len(starts))) for i in range(10))
