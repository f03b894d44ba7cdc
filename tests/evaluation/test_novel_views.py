from unittest.mock import Mock

import numpy as np

from anm_mj.evaluation import novel_views
from anm_mj.evaluation.novel_views import candidate_poses
from anm_mj.io.explored_file import Explored, write_explored
from anm_mj.io.read_run import Run
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.run_records import FrameRecord
from anm_mj.scene.folder import Scene
from anm_mj.types import ExploredState, Intrinsics, Pose2

RNG = np.random.default_rng(0)


def test_the_same_seed_gives_the_same_poses():
    places = RNG.uniform(0.0, 5.0, (30, 2))
    assert candidate_poses(places, 3) == candidate_poses(places, 3)
    assert candidate_poses(places, 3) != candidate_poses(places, 4)
    assert sorted((p.x_m, p.y_m) for p in candidate_poses(places, 3)) == sorted(map(tuple, places.tolist()))


def test_places_of_the_run_before_are_not_novel(tmp_path, monkeypatch):
    places, here = np.array([[0.0, 0.0], [5.0, 0.0], [9.0, 0.0]]), Pose2(0.0, 0.0, 0.0)
    before = ExploredState("gvg", np.array([[5.0, 0.1, 0.0]]), np.zeros((0, 3)), {})
    write_explored(RunFolder(tmp_path).explored, Explored(before, {}))
    frames = (FrameRecord(0, 0.0, here, np.eye(4), here, np.eye(4)),)
    camera = Intrinsics.from_fov(8, 8, 1.5)
    monkeypatch.setattr(novel_views, "scene_area", lambda *_: Mock(places=lambda _: places))
    monkeypatch.setattr(novel_views, "is_clear", lambda *_: True)
    monkeypatch.setattr(novel_views, "observe_at", lambda _, poses, *__: iter(list(poses)))
    found = {}
    for name, manifest in (("alone", {}), ("continued", {"continued_from": {"run": "before"}})):
        record = Run(RunFolder(tmp_path), camera, (8, 8), frames, (), (), manifest, {})
        found[name] = sorted(pose.x_m for pose in novel_views._novel_views(record, Mock(spec=Scene), 0))
    assert found == {"alone": [5.0, 9.0], "continued": [9.0]}
