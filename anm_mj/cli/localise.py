"""``anm-mj localise``: where images were taken, in the map of a finished run."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from anm_mj.cli.command_line import Option
from anm_mj.cli.map import Metres, Seconds, lens_distortion, topics_by_role
from anm_mj.cli.option_types import Count, NewFolder, Settings, require_read, run_fields

if TYPE_CHECKING:
    from anm_mj.cli.console import PlainConsole
    from anm_mj.localise_images import ImagePose

NOTHING_FOUND = 1
"""Exit status where no image was found in the map."""
_LEVEL_M = 1.0
"""Height of images that nobody knows yet [m]; the search has heights of its own."""
_ENDING = "Ending after this image with what was found; Ctrl-C again to quit at once."

_logger = logging.getLogger(__name__)


def localise(
    run: Path,
    images: Path,
    *,
    out: NewFolder | None = None,
    single: bool = False,
    reference: Path | None = None,
    layout: str | None = None,
    camera: Annotated[tuple[float, float, float, float] | None, Option("FX,FY,CX,CY")] = None,
    depth_unit: Metres | None = None,
    distortion: Annotated[str | None, Option("[MODEL,]K1,K2,...")] = None,
    topics: Annotated[Sequence[str], Option("--topic ROLE=NAME")] = (),
    max_gap: Seconds = 0.5,
    every: Count = 1,
    settings: Settings = (),
    **options: Annotated[Any, run_fields("seed", "device")],
) -> int:
    """Find where RGB-D images were taken, in the map of a finished run.

    Poses of the images are not used. The first is looked for in the whole map, the others are tracked. The map stays
    as it is. After an error or Ctrl-C --out holds what was found before. Exit status 1 if no image was found.

    Args:
        run: folder of a run, of anm-mj explore or anm-mj map
        images: a recorded sequence in any layout that anm-mj map reads
        out: folder for the poses, poses.tum and poses.json; by default they are only counted
        single: look for each image on its own: they do not follow one another
        reference: poses in TUM format, in the world of the map, that the found ones are compared with
        layout: name of the layout, as in docs/results.md; by default recognised by its files
        camera: intrinsics [px], if the files are wrong or silent
        depth_unit: metres per unit of a depth image
        distortion: of the lens in the order of OpenCV, as fisheye,K1,K2,K3,K4, or none; by default as the files say
        topics: topic of a bag for colour, depth or camera, where several fit; may be repeated
        max_gap: poses of the reference are interpolated between two that lie no farther apart
        every: read every Nth image only
        settings: any setting of localisation, as in localisation.relocalisation.least_score=0.8; may be repeated
        **options: fields of ``RunConfig``
    """
    from anm_mj.cli.console import PlainConsole, progress_bar
    from anm_mj.cli.progress import Interrupt
    from anm_mj.config import DEFAULT_PRESET, make_config
    from anm_mj.evaluation.trajectory_error import read_reference
    from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
    from anm_mj.localise_images import localise_images, pose_error, require_new, write_poses

    config = make_config(DEFAULT_PRESET, list(settings), scene=str(images), pose="slam", **options)
    require_read(settings, "localisation")
    measured = None if reference is None else read_reference(reference, max_gap)
    if out is not None:
        require_new(out)
    wanted = SequenceOptions(
        layout,
        camera,
        depth_unit,
        up="-y",
        floor_m=-_LEVEL_M,
        every=every,
        topics=topics_by_role(topics),
        needs_poses=False,
        ignores_poses=True,
        max_gap_s=max_gap,
        distortion=lens_distortion(distortion),
    )
    sequence, _ = open_sequence(images, wanted)
    console = PlainConsole()
    poses: list[ImagePose] = []
    failure: Exception | None = None
    with Interrupt(console, _ENDING) as interrupt, progress_bar(console, "localise") as on_progress:

        def on_image(done: int, total: int) -> bool:
            on_progress(done, total)
            return interrupt.is_requested

        try:
            localise_images(run, sequence, config, single=single, on_image=on_image, poses=poses)
        except Exception as err:
            # What was found before is worth more than nothing.
            failure = err
    if failure is not None and not poses:
        raise failure
    try:
        _say_found(console, poses)
        error = None if measured is None else pose_error(poses, measured)
        if error is not None:
            console.say(
                f"Position RMSE {error.position_rmse_cm:.2f} cm, ATE RMSE {error.ate_rmse_cm:.2f} cm after alignment, "
                f"by {reference}."
            )
        elif measured is not None:
            console.say(f"{reference} has fewer than 3 poses at the times of the images that were found (--max-gap).")
        if out is not None:
            write_poses(out, run, images, poses, error)
            console.say(f"Poses: {out}")
        if failure is not None or interrupt.is_requested:
            held = "" if out is None else f"; {out} holds the poses up to there"
            _logger.warning("Localisation ended after %d of %d images%s.", len(poses), len(sequence), held)
    finally:
        if failure is not None:
            raise failure
    return 0 if any(pose.T_world_camera is not None for pose in poses) else NOTHING_FOUND


def _say_found(console: PlainConsole, poses: Sequence[ImagePose]) -> None:
    """Print how many images were found, how well, and why others were not."""
    from anm_mj.io.sequence import ranges_text
    from anm_mj.localise_images import why_not_found

    found = [pose for pose in poses if pose.T_world_camera is not None]
    console.say(f"{len(found)} of {len(poses)} images found.")
    for reason, steps in why_not_found(list(poses)).items():
        console.say(f"Not found: {ranges_text(steps)} ({reason}).")
    deviations = [(pose.deviation_m, pose.deviation_rad) for pose in found]
    if deviations:
        most_m, most_rad = (max(values) for values in zip(*deviations, strict=True))
        console.say(f"Standard deviation at most {100.0 * most_m:.1f} cm and {math.degrees(most_rad):.2f} deg.")
