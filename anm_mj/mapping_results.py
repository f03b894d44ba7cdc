"""What the mapping of a recorded sequence leaves in its run folder: the map, its pictures, and figures of frames."""

import logging
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from anm_mj.config import RunConfig
from anm_mj.evaluation.trajectory_error import reference_error, warn_of_assumed_times
from anm_mj.io.bag_poses import Track
from anm_mj.io.mesh_file import MESH_RESOLUTION_M, write_mesh
from anm_mj.io.plan_file import write_plan
from anm_mj.io.read_run import read_run
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.run_records import FrameRecord
from anm_mj.io.sequence import ranges_text
from anm_mj.io.write import writing
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.planning.policies.anm_s.region_stages import RegionStages
from anm_mj.recording.run_log import RunLog
from anm_mj.sequence_check.find_faults import Verdict
from anm_mj.sequence_check.frame_fit import FrameFit, fit_metrics, misfits, say_misfits
from anm_mj.sequence_check.warn_and_fix import facts
from anm_mj.types import Footprint, Observation
from anm_mj.utils.files import atomic_write
from anm_mj.utils.stopwatch import Stopwatch

_logger = logging.getLogger(__name__)


def frame_metrics(
    folder: RunFolder, fits: list[FrameFit], records: list[FrameRecord], verdict: Verdict | None
) -> dict[str, Any]:
    """What ``metrics.json`` says of how well frames fit each other and the map, with a picture of it. Warnings name
    frames that do not. Raises RunFolderError if the picture cannot be written.
    """
    from anm_mj.viz.plots import draw_fit

    lost = np.array([record.is_lost for record in records])
    positions = np.where(lost[:, None], np.nan, [record.T_world_camera[:3, 3] for record in records])
    steps = [record.step for record in records]
    fitting, residual_m = [fit.fitting for fit in fits], [fit.residual_m for fit in fits]
    say_misfits(fits, positions, [record.time_s for record in records], steps)
    with writing(folder.fit_picture):
        draw_fit(folder.fit_picture, steps, fitting, residual_m, misfits(fits))
    used = 100.0 * float(np.mean([record.is_mapped for record in records]))
    return {"used_percent": used, **fit_metrics(fits), **({} if verdict is None else facts(verdict))}


def tracking_metrics(records: list[FrameRecord], reference: Track | None, watch: Stopwatch) -> dict[str, Any]:
    """What ``metrics.json`` says of a tracked sequence; warnings name the frames that were not mapped."""
    lost = [record.step for record in records if record.is_lost]
    unmapped = [record.step for record in records if not record.is_mapped]
    if lost:
        _logger.warning("The camera was LOST in %d of %d frames: %s.", len(lost), len(records), ranges_text(lost))
    if len(unmapped) > len(lost):
        _logger.warning(
            "%d of %d frames are not in the map, as their pose was not good enough: %s.",
            len(unmapped),
            len(records),
            ranges_text(unmapped),
        )
    metrics: dict[str, Any] = {
        "lost_percent": 100.0 * len(lost) / len(records),
        "unmapped_percent": 100.0 * len(unmapped) / len(records),
        "loops_closed": sum(record.closes_loop for record in records),
        "frame_ms": {stage: ms / len(records) for stage, ms in watch.ms.items() if stage != "finish"},
    }
    if reference is not None:
        warn_of_assumed_times([record.time_s for record in records], reference)
        error = reference_error(records, reference)
        if error is None:
            _logger.warning("%s has fewer than 3 poses at the times of the frames (--max-gap).", reference.name)
        else:
            metrics |= asdict(error)
    return metrics


def write_map(
    folder: RunFolder, config: RunConfig, neural_map: NeuralMap, footprint: Footprint, log: RunLog, last: Observation
) -> None:
    """Write map, mesh, top-down map and its picture, as of the ``last`` frame. Raises RunFolderError if one cannot be
    written.
    """
    from anm_mj.viz.figure_file import save_figure
    from anm_mj.viz.plots import topdown_figure

    with writing(folder.map), atomic_write(folder.map) as partial:
        neural_map.save(partial)
    write_mesh(folder.mesh, neural_map.mesh(MESH_RESOLUTION_M))
    stages = RegionStages(config.planning, footprint)
    for pose in log.poses:
        stages.topdown.visit(pose.xy_m)
    survey = stages.read(neural_map, last).plan("the end")
    write_plan(folder.survey, survey)
    with writing(folder.topdown_picture):
        figure = topdown_figure(
            survey,
            read_run(folder.path).known_poses,
            target_xy_m=log.last_target_xy_m,
            title=f"{Path(config.scene).resolve().name}, {log.num_frames} recorded frames",
        )
        save_figure(figure, folder.topdown_picture)
