from dataclasses import replace
from pathlib import Path

import pytest

from anm_mj.cli.main import main
from anm_mj.io.mesh_file import write_mesh
from anm_mj.io.plan_file import write_plan
from anm_mj.io.run_folder import RunFolder
from anm_mj.recording.recorder import RunRecorder
from tests.box_room import FakeMap, new_recorder, record_steps, room_plan


def box_run(folder: Path, num_steps: int = 40, recorder: RunRecorder | None = None) -> Path:
    """A finished run in the box room, without a neural map."""
    with recorder or new_recorder(folder) as recorder:
        record_steps(recorder, num_steps)
    plan = room_plan()
    write_plan(RunFolder(folder).survey, replace(plan, path_xy_m=plan.path_xy_m[:0]))
    write_mesh(RunFolder(folder).mesh, FakeMap().mesh(0.05))
    (folder / "manifest.json").write_text(
        '{"scene": "box", "policy": "gvg", "seed": 4, "started": "2026-05-01T09:30:00Z"}'
    )
    return folder


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory) -> Path:
    return box_run(tmp_path_factory.mktemp("runs") / "box")


@pytest.fixture(scope="session")
def page(run_folder, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("pages") / "replay.html"
    assert main(["view", str(run_folder), "--export-html", str(path)]) == 0
    return path
