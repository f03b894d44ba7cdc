import dataclasses

import numpy as np
import pytest
from PIL import Image

from anm_mj.errors import RunFolderError
from anm_mj.io.plan_file import read_plan, write_plan
from anm_mj.recording.record_config import RecordConfig
from anm_mj.types import OCCUPIED, Plan
from tests.box_room import new_recorder, observe, record_steps, room_plan


def test_every_part_of_a_decision_comes_back(tmp_path):
    plan = room_plan()
    assert plan.topdown is not None
    topdown = dataclasses.replace(plan.topdown, no_floor=plan.topdown.state == OCCUPIED)
    plan = dataclasses.replace(plan, topdown=topdown)
    write_plan(tmp_path / "a.npz", plan)
    read = read_plan(tmp_path / "a.npz")
    np.testing.assert_allclose(read.path_xy_m, plan.path_xy_m)
    for part in ("topdown", "graph"):
        for field in dataclasses.fields(getattr(plan, part)):
            if field.name not in ("surface_xy_m", "frontier_xy_m"):
                expected, found = (getattr(getattr(one, part), field.name) for one in (plan, read))
                np.testing.assert_allclose(found, expected, rtol=1e-3, err_msg=field.name)
    for expected, found in zip(plan.regions, read.regions, strict=True):
        for field in dataclasses.fields(expected):
            np.testing.assert_allclose(getattr(found, field.name), getattr(expected, field.name), rtol=1e-6)


def test_a_decision_without_map_and_graph(tmp_path):
    write_plan(tmp_path / "a.npz", Plan("turn", np.zeros((0, 2))))
    read = read_plan(tmp_path / "a.npz")
    assert (len(read.path_xy_m), read.topdown, read.graph, read.regions) == (0, None, None, ())


def test_a_damaged_decision_is_one_sentence(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"PK")
    with pytest.raises(RunFolderError, match="copy the run again"):
        read_plan(tmp_path / "a.npz")


@pytest.mark.parametrize(("images", "side_px"), [("small", 128), ("full", 256), ("none", None)])
def test_what_a_run_keeps_changes_none_of_its_other_files(tmp_path, images, side_px):
    default, other = tmp_path / "default", tmp_path / "other"
    for path, record in ((default, None), (other, RecordConfig(images=images, plans=images == "small"))):
        with new_recorder(path, record=record) as recorder:
            record_steps(recorder, 4)
    for path in default.iterdir():
        if path.is_file():
            assert (other / path.name).read_bytes() == path.read_bytes(), path.name
    assert [path.name for path in sorted((other / "plans").glob("*"))] == (["000000.npz"] if images == "small" else [])
    kept = sorted((other / "rgb").glob("*"))
    assert len(kept) == (0 if side_px is None else 5)
    for path in kept:
        with Image.open(path) as image:
            assert image.size == (side_px, side_px)
            # A grey room; JPEG may be a level off.
            assert np.abs(np.asarray(image).astype(int) - observe(0, recorder.poses[0]).rgb[0, 0]).max() <= 2


def test_an_unknown_size_of_images_is_one_sentence():
    with pytest.raises(RunFolderError, match=r"record\.images is 'big'; it must be one of none, small, full"):
        RecordConfig(images="big")


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"state": np.zeros((0, 0), np.int8), "clearance_m": np.zeros((0, 0), np.float16)}, "has 0 x 0 cells"),
        ({"state": np.zeros((6000, 5000), np.int8)}, "ANM_MJ_MAX_CELLS"),
        ({"region_vertex": -99}, "regions name vertices -99"),
        ({"region_vertex": 10**6}, "regions name vertices 1000000"),
        ({"region_members": 0}, "0 members"),
    ],
)
def test_a_decision_that_contradicts_itself_is_one_sentence(tmp_path, changed, said):
    path = tmp_path / "a.npz"
    write_plan(path, room_plan())
    arrays = dict(np.load(path))
    for name, value in changed.items():
        arrays[name] = value if isinstance(value, np.ndarray) else np.full_like(arrays[name], value)
    np.savez_compressed(path, **arrays)
    with pytest.raises(RunFolderError, match=said):
        read_plan(path)
