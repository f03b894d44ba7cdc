"""The formats that a run is exported to, by name."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from anm_mj.errors import MapError, RunFolderError
from anm_mj.utils.close_names import close_name
from anm_mj.utils.extras import install


@dataclass(frozen=True)
class Format:
    """One way to take a run away."""

    function: str
    """``module.function`` of this package: ``(run, folder) -> paths``."""
    words: str
    long: bool = False
    """Whether the function also takes ``on_progress``."""
    package: str = ""
    """The module that it needs and that is not installed by default."""
    timed: bool = False
    """Whether other recordings may be played beside it: its times count from 1970, not from the run's start."""


FORMATS = {
    "glb": Format("surface.export_glb", "the mesh, y up"),
    "ply": Format("surface.export_ply", "the mesh, z up"),
    "obj": Format("surface.export_obj", "the mesh, z up"),
    "tum": Format("trajectory.export_tum", "trajectories of camera and base"),
    "kitti": Format("trajectory.export_kitti", "trajectory of the camera"),
    "nerfstudio": Format("images.export_nerfstudio", "images, depth, poses, points: transforms.json"),
    "colmap": Format("images.export_colmap", "images, poses, points: COLMAP's text files"),
    "nav2": Format("floor_plan.export_nav2", "the top-down map: map.yaml and map.pgm"),
    "graphml": Format("floor_plan.export_graphml", "the Voronoi graph"),
    "geojson": Format("floor_plan.export_geojson", "graph, regions and trajectory"),
    "sdf": Format("volume.export_sdf", "signed distances as a volume: sdf.npz", long=True),
    "esdf": Format("volume.export_esdf", "a slice of the Euclidean distance field: esdf.npz", long=True),
    "route": Format("floor_plan.export_route", "the Voronoi graph for nav2's route server: route.geojson"),
    "figures": Format("figures.export_figures", "top-down map and curve as PNG, PDF and SVG"),
    "rosbag": Format(
        "rosbag.export_rosbag", "everything over time: a ROS 2 bag in MCAP", long=True, package="rosbags", timed=True
    ),
}
ALL = "all"
_logger = logging.getLogger(__name__)


def export_run(
    run: Path,
    names: Sequence[str],
    out: Path | None = None,
    on_progress: Callable[[str, int, int], None] = lambda name, done, total: None,
    start_s: float | None = None,
) -> list[Path]:
    """Write a run in other formats. Returns the files and folders written.

    Args:
        run: The run folder.
        names: Names of formats, or ``all`` for every one whose package is installed and of which the run has what it
            needs; the others are named in the log.
        out: Folder to write into; None = ``export`` in the run folder.
        on_progress: Called with the format's name and what is done and in all.
        start_s: When the run began, for what is played over time [s since 1970]; None = as the run says, 0 = times
            count from the run's start.

    Raises:
        RunFolderError: There is no such format, the run lacks what it needs, or the folder cannot be written.
        MapError: The run's map cannot be read.
    """
    known = (*FORMATS, ALL)
    for name in names:
        if name not in known:
            raise RunFolderError(
                f"There is no format '{name}'{close_name(name, known)}; choose from {', '.join(known)}."
            )
    chosen = list(dict.fromkeys(each for name in names for each in (FORMATS if name == ALL else (name,))))
    # Here, not above: the command line asks for the names of the formats alone.
    from anm_mj.export.wall_clock import on_wall_clock
    from anm_mj.io.read_run import read_run
    from anm_mj.io.run_folder import refuse_links
    from anm_mj.io.write import writing

    record = read_run(run)
    if not record.frames:
        raise RunFolderError(f"{run} holds no frame yet; wait for the run's first step.")
    if out is None:
        out = record.folder.path / "export"
        refuse_links(out)
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
    written = []
    for number, name in enumerate(chosen):
        on_progress(name, number, len(chosen))
        entry = FORMATS[name]
        module, _, function = entry.function.partition(".")
        options: dict[str, Any] = {}
        if entry.long:
            options["on_progress"] = lambda done, total, name=name: on_progress(name, done, total)
        try:
            if entry.package and find_spec(entry.package) is None:
                raise RunFolderError(install(entry.package))
            run_made = on_wall_clock(record, start_s) if entry.timed else record
            written += getattr(import_module(f"anm_mj.export.{module}"), function)(run_made, out, **options)
        except (RunFolderError, MapError) as err:
            if name in names:
                raise
            _logger.warning("Left out: %s. %s", name, err)
    return written
