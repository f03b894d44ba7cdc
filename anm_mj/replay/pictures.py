"""The colour images of a finished run: those it kept, or rendered again from its scene."""

import itertools
import logging
from collections.abc import Iterator

import numpy as np
from jaxtyping import UInt8

from anm_mj.errors import AnmError
from anm_mj.evaluation.rerender import explored_scene, observe_at
from anm_mj.io.image import read_image
from anm_mj.io.read_run import Run
from anm_mj.replay.timeline import is_any

_logger = logging.getLogger(__name__)


def kept_images(run: Run) -> bool:
    """Whether the run kept its colour images."""
    return bool(run.frames) and all(run.folder.image(frame.step).is_file() for frame in run.frames)


def pictures(run: Run, scene: str | None = None) -> Iterator[UInt8[np.ndarray, "h w 3"] | None]:
    """The colour image of each frame, in order; None for all where there is none to be had. This is logged, and so is
    that images rendered again lack what moved. ``scene`` is the present name or folder of its scene, if it has moved.
    Raises RunFolderError if a kept image is damaged.
    """
    if kept_images(run):
        for frame in run.frames:
            yield read_image(run.folder.image(frame.step), "RGB")
        return
    try:
        world = explored_scene(run, scene)
        # The camera stood where the robot truly was, whatever it believed.
        rendered = observe_at(world, [frame.true_pose for frame in run.frames], run.intrinsics.width, run)
        first = next(rendered)
    except AnmError as err:
        _logger.warning("The run kept no colour images, and they cannot be rendered again: %s", err)
        yield from [None] * len(run.frames)
        return
    if is_any(run.frames[0]):
        _logger.warning(
            "The run kept no colour images: they are rendered again, without the people and things that move."
        )
    yield from (observation.rgb for observation in itertools.chain((first,), rendered))
