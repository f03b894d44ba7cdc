"""A fault of a recorded sequence is found, named, and put right."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anm_mj.errors import ConfigError
from anm_mj.frames import pixel_directions
from anm_mj.io.sequence import Sequence
from anm_mj.sequence_check.correction import Correction, all_axes, axes_matrix, combined, corrected_sequence
from anm_mj.sequence_check.evidence import gather
from anm_mj.sequence_check.find_faults import find_faults
from anm_mj.sequence_check.warn_and_fix import BeforeMapping, options
from tests.sequence_check.conftest import CAMERA, frame, pose_at


def test_a_frame_that_cannot_be_read_is_left_out_whatever_share_may_be_bad(walk, tmp_path):
    (tmp_path / "cut.jpg").write_bytes(b"\xff\xd8\xff")
    frames = [*walk.frames[:12]]
    frames[4] = replace(frames[4], colour=tmp_path / "cut.jpg")
    evidence = gather(replace(walk, frames=tuple(frames), max_bad=1.0))
    assert evidence is not None
    assert len(evidence.views) == 11


def verdict_of(sequence):
    evidence = gather(sequence)
    assert evidence is not None
    return find_faults(evidence, depth_unit_m=sequence.depth_unit_m, up="z")


def with_poses(sequence, change):
    return replace(
        sequence, frames=tuple(replace(one, T_world_camera=change(one.T_world_camera)) for one in sequence.frames)
    )


def scaled(T, factor):
    T = T.copy()
    T[:3, 3] *= factor
    return T


def with_depth(sequence, change):
    return replace(
        sequence, frames=tuple(replace(one, depth=lambda one=one: change(one.depth())) for one in sequence.frames)
    )


def turned(axes):
    turn = np.eye(4)
    turn[:3, :3] = axes_matrix(axes)
    return turn


def flipped(sequence):
    frames = tuple(
        replace(one, colour=lambda one=one: one.colour()[:, ::-1], depth=lambda one=one: one.depth()[:, ::-1])
        for one in sequence.frames
    )
    return replace(sequence, frames=frames)


Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
LENGTHS = np.linalg.norm(pixel_directions(CAMERA), axis=-1).astype(np.float32)
FAULTS = {
    "poses": (lambda s: with_poses(s, np.linalg.inv), Correction(convention="world-to-camera")),
    "axes": (lambda s: with_poses(s, lambda T: T @ turned("RUB")), Correction(axes="RUB")),
    "mirrored": (flipped, Correction(mirrored=True)),
    "ray": (lambda s: with_depth(s, lambda d: d * LENGTHS), Correction(ray_depth=True)),
    "scale": (lambda s: with_poses(s, lambda T: scaled(T, 0.37)), Correction(pose_scale=1 / 0.37)),
    "unit": (lambda s: with_depth(s, lambda d: d * np.float32(5.0)), Correction(depth_scale=0.2)),
    "focal": (
        lambda s: replace(s, intrinsics=replace(CAMERA, fx=CAMERA.fx * 1.3, fy=CAMERA.fy * 1.3)),
        Correction(focal_scale=1 / 1.3),
    ),
    "time": (
        lambda s: replace(s, frames=tuple(replace(one, T_world_camera=pose_at(one.time_s - 0.1)) for one in s.frames)),
        Correction(time_offset_s=0.1),
    ),
    "colour": (
        lambda s: replace(s, frames=tuple(frame(one.time_s, one.time_s + 2 / 15.0) for one in s.frames)),
        Correction(colour_offset_s=2 / 15.0),
    ),
    "up": (lambda s: with_poses(s, lambda T: Y_UP @ T), Correction(up="y")),
}


def test_a_sound_sequence_fits(walk):
    verdict = verdict_of(walk)
    assert not verdict.findings
    assert not verdict.contradicts
    assert verdict.stated.fitting > 0.95


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_is_named_with_its_value(walk, kind):
    spoil, expected = FAULTS[kind]
    verdict = verdict_of(replace(spoil(walk), depth_unit_m=0.005 if kind == "unit" else 0.001))
    assert [finding.kind for finding in verdict.findings] == [kind]
    found = verdict.correction
    assert found.changes().keys() == expected.changes().keys()
    for name, value in expected.changes().items():
        stated = getattr(found, name)
        assert stated == value if isinstance(value, str | bool) else stated == pytest.approx(value, abs=0.01, rel=0.03)


@pytest.mark.parametrize("factor", [1000.0, 100.0, 0.001])
def test_positions_in_another_unit_are_named(walk, factor):
    verdict = verdict_of(with_poses(walk, lambda T: scaled(T, factor)))
    assert [finding.kind for finding in verdict.findings] == ["scale"]
    assert verdict.correction.pose_scale == pytest.approx(1.0 / factor, rel=0.03)


def test_fixing_makes_it_fit_and_says_how(walk, caplog):
    judged = BeforeMapping(fix=True)
    fixed, up = judged(with_poses(walk, np.linalg.inv), "z")
    assert judged.applied == ("--poses world-to-camera",)
    assert up == "z"
    assert not verdict_of(fixed).findings
    assert "--poses world-to-camera" in caplog.text
    assert np.allclose(fixed.frames[7].T_world_camera, walk.frames[7].T_world_camera)


@pytest.mark.parametrize("given", [Correction(convention="world-to-camera"), Correction(axes="FLU")])
def test_a_finding_completes_what_was_given(walk, given):
    stated = with_poses(walk, lambda T: T @ turned("RUB"))
    if given.convention != "camera-to-world":
        stated = with_poses(stated, np.linalg.inv)
    judged = BeforeMapping(given, fix=True)
    fixed, _ = judged(stated, "z")
    assert judged.applied == ("--axes RUB",)
    assert np.allclose(fixed.frames[7].T_world_camera, walk.frames[7].T_world_camera)


def test_what_was_given_and_what_is_found_add_up():
    given = Correction(pose_scale=2.0, mirrored=True, time_offset_s=0.5)
    found = combined(given, Correction(axes="RUB", pose_scale=1.5, mirrored=True, time_offset_s=0.25))
    assert found == Correction(axes="RUB", pose_scale=3.0, time_offset_s=0.75)
    words = options(found, Sequence(Path("walk"), CAMERA, 0.001, ()), given)
    assert words == ["--axes RUB", "no --mirrored", "--pose-scale 3", "--time-offset=0.750"]


def test_poses_without_rhyme_or_reason_contradict_depth(walk):
    order = np.random.default_rng(3).permutation(len(walk))
    shuffled = [walk.frames[k].T_world_camera for k in order]
    wrong = replace(
        walk,
        frames=tuple(replace(one, T_world_camera=T) for one, T in zip(walk.frames, shuffled, strict=True)),
    )
    assert verdict_of(wrong).contradicts


def test_corrected_images_are_those_of_the_true_sequence(walk):
    stated = with_depth(flipped(walk), lambda d: d * LENGTHS[:, ::-1])
    true = next(walk.observations())
    fixed = next(corrected_sequence(stated, Correction(mirrored=True, ray_depth=True)).observations())
    assert np.allclose(fixed.depth_m, true.depth_m, rtol=1e-5)
    assert np.array_equal(fixed.rgb, true.rgb)


def test_colour_of_another_time_comes_from_its_frame(walk):
    fixed = corrected_sequence(walk, Correction(colour_offset_s=2 / 15.0))
    assert fixed.frames[0].colour is walk.frames[0].colour
    assert fixed.frames[0].time_s == pytest.approx(2 / 15.0)


def test_all_axes_are_different():
    assert len(set(all_axes())) == 48


@pytest.mark.parametrize("wrong", [{"axes": "RDD"}, {"axes": "rdf"}, {"convention": "c2w"}, {"pose_scale": 0.0}])
def test_a_correction_that_cannot_be_is_refused(wrong):
    with pytest.raises(ConfigError):
        Correction(**wrong)
