"""A prior run is compared with the scene, and its files with each other."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from anm_mj.errors import MapError
from anm_mj.prior_run import PriorRun
from anm_mj.types import ExploredState, OccupancyGrid


def prior_run(poses=((1.0, 1.0, 0.0),)) -> Any:
    run = SimpleNamespace(
        manifest={"scene": "a/home", "scene_hash": "1"}, folder=SimpleNamespace(path="run", explored="x")
    )
    found = ExploredState("gvg", np.array(poses), np.zeros((0, 3)), {})
    return SimpleNamespace(run=run, explored=SimpleNamespace(prior=found))


@pytest.mark.parametrize(("scene", "scene_hash", "said"), [("b/home", "2", 0), ("flat", "1", 0), ("flat", "2", 1)])
def test_another_scene_is_said(caplog, scene, scene_hash, said):
    PriorRun.compare_scene(prior_run(), scene, scene_hash)
    assert len(caplog.records) == said


def test_places_outside_of_the_map_are_refused():
    shape = (4, 20, 40)
    grid = OccupancyGrid(np.zeros(shape, np.int8), np.zeros(shape, np.float32), np.zeros(3), 0.1)
    PriorRun._require_places(prior_run([(4.5, 2.5, 0.0)]), grid)
    with pytest.raises(MapError, match="names the place"):
        PriorRun._require_places(prior_run([(2.5, 4.5, 0.0)]), grid)
