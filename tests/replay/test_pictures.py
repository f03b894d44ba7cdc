import math
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.evaluation.rerender import observe_at
from anm_mj.io.read_run import Run
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.run_records import FrameRecord
from anm_mj.replay.pictures import pictures
from anm_mj.scene.folder import load_scene
from anm_mj.types import Intrinsics


def test_images_that_were_not_kept_show_what_the_camera_truly_saw(tmp_path):
    scene, camera = load_scene("room"), Intrinsics.from_fov(64, 64, 1.2)
    true = [replace(scene.starts[0], yaw_rad=scene.starts[0].yaw_rad + turned) for turned in (0.0, 0.5)]
    frames = tuple(
        FrameRecord(step, 0.1 * step, replace(pose, yaw_rad=pose.yaw_rad + math.pi), np.eye(4), pose, np.eye(4))
        for step, pose in enumerate(true)
    )
    facts = {"scene": "room", "scene_hash": scene.hash}
    shown = list(pictures(Run(RunFolder(tmp_path), camera, (64, 64), frames, (), (), facts, {})))
    for image, seen in zip(shown, observe_at(scene, true, 64), strict=True):
        assert image is not None
        np.testing.assert_array_equal(image, seen.rgb)


@pytest.mark.parametrize("people", [(), ((1.0, 1.0, 0.0, 0.0, 0.0),)])
def test_it_is_said_that_images_rendered_again_show_nobody(tmp_path, caplog, people):
    scene, camera = load_scene("room"), Intrinsics.from_fov(64, 64, 1.2)
    frame = FrameRecord(0, 0.0, scene.starts[0], np.eye(4), scene.starts[0], np.eye(4), people=people)
    facts = {"scene": "room", "scene_hash": scene.hash}
    assert len(list(pictures(Run(RunFolder(tmp_path), camera, (64, 64), (frame,), (), (), facts, {})))) == 1
    assert ("without the people" in caplog.text) == bool(people)
