import math

import pytest

from anm_mj.io.run_folder import RunFolder
from anm_mj.mapping.mapping_config import MAPPING_PRESETS
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.recording.record_config import RecordConfig
from anm_mj.types import Pose2
from tests.box_room import new_recorder, observe
from tests.replay.conftest import box_run


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory):
    """A run in the box room with full images and a map that has learnt its walls."""
    path = tmp_path_factory.mktemp("exported") / "box"
    box_run(path, 24, new_recorder(path, record=RecordConfig(images="full")))
    neural_map = NeuralMap(MAPPING_PRESETS["quick"](), seed=0, device="cpu")
    for step in range(12):
        neural_map.integrate(observe(step, Pose2(0.0, 0.0, step * math.pi / 6.0)))
    neural_map.save(RunFolder(path).map)
    return path
