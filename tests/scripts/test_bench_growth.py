"""What the benchmark of growth takes pictures of and writes down, without timing anything."""

import json

import numpy as np

from anm_mj.frames import back_project
from scripts import bench_growth


def test_every_pixel_lies_on_a_wall_or_on_the_cupboard_of_its_room():
    low, high = bench_growth.CUPBOARD_M
    rooms = set()
    for view in bench_growth.building_views(5, 24):
        camera = view.T_world_camera[:3, 3]
        pitch = bench_growth.ROOM_M[:2] + 0.2
        corner = np.array([*(camera[:2] // pitch * pitch), 0.0])
        rooms.add(tuple(corner))
        points = back_project(view.depth_m, view.intrinsics, view.T_world_camera).reshape(-1, 3) - corner
        to_wall = np.minimum(points, bench_growth.ROOM_M - points).min(axis=1)
        to_cupboard = np.maximum(low - points, points - high).max(axis=1)
        assert np.abs(to_wall).min() < 1e-4
        np.testing.assert_allclose(np.minimum(np.abs(to_wall), np.abs(to_cupboard)), 0.0, atol=1e-4)
        assert not ((points > low + 1e-4) & (points < high - 1e-4)).all(axis=1).any()
    assert len(rooms) == 5


def test_buildings_are_compared_by_the_cost_of_a_step(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(bench_growth, "NUM_TIMED", 2)
    out = tmp_path / "growth.json"
    bench_growth.main(preset="quick", areas_m2=(15.0, 40.0), image_px=32, json_file=out)
    found = json.loads(out.read_text())
    small, large = found["rows"]
    assert (small["map"], small["observations"]) == ("15 m2", 12)
    assert (large["map"], large["observations"]) == ("40 m2", 24)
    assert 1.6 < large["floor_m2"] / small["floor_m2"] < 2.4
    assert found["cost_large_by_small"] == large["step_ms"] / small["step_ms"]
    assert "cost of a step, 40 m2 / 15 m2:" in capsys.readouterr().out
