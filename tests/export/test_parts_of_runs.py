"""Exports of runs that were killed, and of robots that were lost for a while."""

import json

import numpy as np
import pytest

from anm_mj.export.figures import topdown_of
from anm_mj.export.formats import export_run
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.read_run import read_run
from tests.replay.conftest import box_run


def test_images_of_a_run_without_a_mesh_are_exported_without_points(tmp_path):
    path = box_run(tmp_path / "box", 3)
    (path / "mesh.ply").unlink()
    nerfstudio, colmap = export_run(path, ["nerfstudio", "colmap"], tmp_path / "out")
    facts = json.loads((nerfstudio / "transforms.json").read_text())
    assert len(facts["frames"]) == len(list((nerfstudio / "images").iterdir())) == 4
    assert "ply_file_path" not in facts
    assert not (nerfstudio / "points.ply").exists()
    model = {file.name: file.read_text().splitlines() for file in (colmap / "sparse" / "0").iterdir()}
    assert len(model["images.txt"]) == 2 + 2 * 4
    assert [line for line in model["points3D.txt"] if not line.startswith("#")] == []


@pytest.fixture
def lost_run(tmp_path):
    """A run of 40 steps whose robot was lost three times; frames 38 and 40 stand alone."""
    path = box_run(tmp_path / "box", 40)
    lines = read_jsonl(path / "frames.jsonl")
    for step in (*range(20, 29), *range(34, 38), 39):
        lines[step] |= {"x_m": 9.0, "localisation": {"state": "LOST", "usable": False}}
    (path / "frames.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return read_run(path)


def test_the_trajectory_is_a_line_for_each_piece_that_is_known(lost_run, tmp_path):
    (path,) = export_run(lost_run.folder.path, ["geojson"], tmp_path / "out")
    lines = [one for one in json.loads(path.read_text())["features"] if one["properties"]["kind"] == "trajectory"]
    assert {one["geometry"]["type"] for one in lines} == {"LineString"}
    xy_m = [frame.pose.xy_m.tolist() for frame in lost_run.frames]
    assert [one["geometry"]["coordinates"] for one in lines] == [xy_m[:20], xy_m[29:34]]


def test_a_run_without_a_known_pose_has_no_line_of_a_trajectory(lost_run, tmp_path):
    lines = read_jsonl(lost_run.folder.frames)
    for line in lines:
        line["localisation"] = {"state": "LOST", "usable": False}
    lost_run.folder.frames.write_text("".join(json.dumps(line) + "\n" for line in lines))
    for path in export_run(lost_run.folder.path, ["tum", "kitti"], tmp_path / "out"):
        assert path.read_text() == "", path


def test_the_figure_leaves_out_where_the_robot_was_lost(lost_run):
    drawn = topdown_of(lost_run).axes[0].collections
    (trajectory,) = [each for each in drawn if each.get_array() is not None]
    steps = trajectory.get_array()
    assert steps is not None
    # Every third step moves.
    assert steps.tolist() == [2, 5, 8, 11, 14, 17, 29, 32]
    assert trajectory.get_clim() == (0.0, 40.0)
    ends = np.array([frame.pose.xy_m for frame in lost_run.frames])
    for step, segment in zip(steps.astype(int), trajectory.get_segments(), strict=True):
        np.testing.assert_allclose(segment, ends[[step, step + 1]])
