"""What a map renders in the place of true views, novel or fixed ones, and how good it is."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8

from anm_mj.evaluation.view_quality import ViewQuality, ViewsResult, compare_view, mean_quality
from anm_mj.io.to_json import write_json
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.types import Observation
from anm_mj.utils.progress import Progress, unheard


def compare_views(
    neural_map: NeuralMap, views: Iterable[Observation], num_views: int, on_progress: Progress = unheard
) -> Iterator[tuple[Observation, UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"], ViewQuality]]:
    """Each true view, colour and planar depth [m] that a map renders in its place, and their quality. ``num_views`` is
    for the progress.
    """
    for done, view in enumerate(views, start=1):
        rgb, depth_m = neural_map.render(view.intrinsics, view.T_world_camera)
        yield view, rgb, depth_m, compare_view(rgb, depth_m, view.rgb, view.depth_m)
        on_progress(done, num_views)


def write_views(path: Path, rows: Sequence[dict[str, Any]], **facts: Any) -> ViewsResult:
    """Write ``novel_views.json`` or ``fixed_views.json``; returns the means. Each row has the ``quality`` of a view;
    ``facts`` are further entries of the file. Raises RunFolderError if the file cannot be written.
    """
    result = ViewsResult(len(rows), mean_quality([row["quality"] for row in rows]) if rows else None)
    write_json(path, {"num_views": result.num_views, **facts, "mean": result.mean, "views": rows})
    return result
