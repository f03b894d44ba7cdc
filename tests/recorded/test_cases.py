"""What people bring is read rightly, mended by the option that is named, or refused in words."""

import json
import logging

import numpy as np
import pytest
import trimesh

from anm_mj.cli.main import main
from anm_mj.errors import RunFolderError
from anm_mj.frames import pixel_directions, transform_points
from anm_mj.geometry.lens_distortion import LensDistortion
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
from anm_mj.sequence_check.warn_and_fix import BeforeMapping
from tests.recorded import layouts
from tests.recorded.cases import CASES, GIVEN, WALK, seen_by
from tests.recorded.walk import CAMERA, to_walls_m

OF_NAME = pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])


def to_the_room(T_world_camera):
    """From the world of a sequence, by its first camera; z stays up, and the floor where it is."""
    T = WALK[0].T_world_camera @ np.linalg.inv(T_world_camera)
    assert T[2, 2] > 0.999
    assert abs(T[2, 3]) < 0.03
    return T


def seen_to_walls_m(one, T_room_world=np.eye(4)):  # noqa: B008
    """Distances from the walls of all points that a frame shows."""
    points = pixel_directions(one.intrinsics) * one.depth_m[..., None].astype(float)
    known = np.isfinite(one.depth_m)
    assert known.mean() > 0.5
    return to_walls_m(transform_points(T_room_world @ one.T_world_camera, points[known]))


@OF_NAME
def test_what_is_brought_is_read_or_refused(case, tmp_path, caplog):
    caplog.set_level(logging.INFO)
    path = case.write(tmp_path) or tmp_path
    # Without a fault to be found, the check is left to the longer test.
    judge = BeforeMapping(fix=True) if case.mend else None
    camera = (32.0, 32.0, 32.0, 32.0) if case.options == GIVEN else None
    options = SequenceOptions(camera=camera, judge=judge)
    if case.refused:
        with pytest.raises(RunFolderError) as refusal:
            open_sequence(path, options)
        assert all(words in str(refusal.value) for words in case.says)
        return
    sequence, _ = open_sequence(path, options)
    assert all(words in caplog.text for words in case.says)
    for applied, named in zip(judge.applied if judge else (), case.mend, strict=True):
        assert applied.startswith(named)
    observations = list(sequence.observations())
    assert len(observations) == case.frames
    if case.jumps:
        return
    T = to_the_room(observations[0].T_world_camera)
    for one in observations:
        distance_m = seen_to_walls_m(one, T)
        # The nearest pixel of a bent image lies up to half a pixel beside the ray.
        assert np.percentile(distance_m, 98) < 0.06
        assert distance_m.mean() < 0.02


@pytest.mark.parametrize("words", ["fisheye,-0.002,0.038,-0.036,0.006", "equidistant,0", "0.1,0.02", "0,0,0,0,0,0.05"])
def test_a_lens_that_is_given_in_words_is_taken_out(tmp_path, words):
    lens = LensDistortion.read(words)
    layouts.write_ours(tmp_path / "walk", seen_by(CAMERA, lens))
    for given, is_right in ((lens, True), (None, False)):
        sequence, _ = open_sequence(tmp_path / "walk", SequenceOptions(distortion=given))
        distance_m = np.concatenate([seen_to_walls_m(one) for one in sequence.observations()])
        assert bool(distance_m.mean() < 0.02) is is_right


@pytest.mark.slow
@OF_NAME
def test_what_is_brought_is_mapped_rightly(case, tmp_path, capsys):
    path = case.write(tmp_path) or tmp_path
    words = ["map", str(path), *case.options, "--preset", "quick"]
    if case.mend:
        # Where nothing at all can be mapped, that is an error.
        assert main([*words, "--out", str(tmp_path / "as it is")]) in (0, 2)
        said = capsys.readouterr()
        assert all(each in " ".join((said.out + said.err).split()) for each in (*case.says, *case.mend, "or --fix"))
        words.append("--fix")
    out = tmp_path / "out"
    assert main([*words, "--out", str(out)]) == (2 if case.refused else 0)
    said = capsys.readouterr()
    assert all(each in " ".join((said.out + said.err).split()) for each in (*case.says, *case.jumps))
    if case.refused or case.jumps:
        assert out.exists() is not case.refused
        return
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["frames"] == case.frames
    T = to_the_room(np.array(read_jsonl(out / "frames.jsonl")[0]["T_world_camera"]))
    mesh = trimesh.load_mesh(out / "mesh.ply")
    distance_m = to_walls_m(transform_points(T, np.asarray(mesh.vertices)))
    print(f"{case.name}: {100 * distance_m.mean():.2f} cm")
    assert distance_m.mean() < 0.025
