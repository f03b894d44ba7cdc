from pathlib import Path

import numpy as np
import pytest

from anm_mj.io.recorder import RunRecorder
from anm_mj.io.run_folder import RunFolder
from anm_mj.types import StopReason
from tests.box_room import FakeMap, new_recorder, record_steps, room_plan


def box_run(folder: Path, num_steps: int = 40, recorder: RunRecorder | None = None) -> Path:
    """A finished run in the box room, without a neural map."""
    with recorder or new_recorder(folder) as recorder:
        record_steps(recorder, num_steps)
        recorder.finish(StopReason.BUDGET, FakeMap(), room_plan(), wall_s=1.0, loop_s=1.0)
    RunFolder(folder).map.unlink()
    (folder / "manifest.json").write_text('{"scene": "box", "policy": "gvg", "seed": 4}')
    return folder


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory) -> Path:
    return box_run(tmp_path_factory.mktemp("runs") / "box")


@pytest.fixture
def rng():
    return np.random.default_rng(0)
