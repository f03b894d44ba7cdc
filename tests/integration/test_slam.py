"""Localisation in the loop: odometry that drifts, a run that is resumed, a robot that somebody moves."""

import json
from pathlib import Path

import numpy as np
import pytest

from anm_mj.config import make_config
from anm_mj.errors import ConfigError, MapError
from anm_mj.events import Observed, On, Stepped
from anm_mj.frames import move_pose, wrap_angle
from anm_mj.io.curve_file import read_curve
from anm_mj.io.explored_file import read_explored
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.read_run import read_run
from anm_mj.localisation.keyframe_graph import Correction, KeyframeGraph
from anm_mj.mapping.map_file import read_map
from anm_mj.resume import resume
from anm_mj.run import run
from anm_mj.sim.sim_robot import SimRobot
from anm_mj.types import StopReason
from tests.scene.small import make_small_scene

NOISY = ("model.wheel_noise=0.05", "image_px=64")
STEPS = 60

pytestmark = pytest.mark.usefixtures("quick_results")


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("scenes") / "small"
    make_small_scene(folder)
    return folder


def explore(scene, out, *settings, pose="slam", observers=(), steps=STEPS, **options):
    config = make_config(
        "quick", [*NOISY, *settings], scene=str(scene), pose=pose, steps=steps, seed=3, device="cpu", **options
    )
    return run(config, out=out, observers=observers)[1]


@pytest.fixture(scope="module")
def localised(scene, tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "slam"
    return folder, explore(scene, folder)


def test_the_map_corrects_what_the_wheels_get_wrong(scene, localised, tmp_path):
    folder, metrics = localised
    drifting = explore(scene, tmp_path / "odometry", pose="odometry")
    assert drifting.position_rmse_cm is not None
    assert drifting.final_heading_error_deg is not None
    assert drifting.position_rmse_cm > 1.0
    assert metrics.position_rmse_cm < 0.3 * drifting.position_rmse_cm
    assert metrics.final_heading_error_deg < 0.3 * drifting.final_heading_error_deg
    assert metrics.observed_f_score > drifting.observed_f_score
    assert metrics.lost_percent == 0.0
    frames = read_jsonl(folder / "frames.jsonl")
    assert all(frame["localisation"]["state"] == "TRACKING" for frame in frames)
    assert len((folder / "trajectory_true.tum").read_text().splitlines()) == len(frames)


def test_the_curve_says_how_wrong_the_believed_poses_are(localised):
    curve, frames = read_curve(localised[0] / "curve.csv"), read_run(localised[0]).frames
    wrong_cm = [100.0 * np.linalg.norm(frame.pose.xy_m - frame.true_pose.xy_m) for frame in frames]
    assert np.isnan(curve["position_error_cm"][0])  # The first pose is exact.
    np.testing.assert_allclose(curve["position_error_cm"][1:], np.array(wrong_cm)[curve["step"].astype(int)[1:]])
    assert 0.0 < curve["position_error_cm"][-1] < 3.0
    assert (curve["heading_error_deg"][1:] < 2.0).all()
    for frame in frames:
        assert frame.covariance_xy_m2 is not None
        assert min(frame.covariance_xy_m2[0], frame.covariance_xy_m2[2]) > 0.0


def test_a_seed_gives_the_same_run_and_an_interrupted_one_goes_on_to_the_same_end(scene, localised, tmp_path):
    stop = On(Stepped, lambda stepped: stepped.step == 13)
    explore(scene, tmp_path / "run", "checkpoint.every_steps=5", observers=(stop,), steps=25)
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["stop_reason"] == "INTERRUPTED"
    resume(tmp_path / "run")
    for name in ("frames.jsonl", "trajectory.tum", "trajectory_true.tum"):
        # The other run goes on from there.
        lines = (tmp_path / "run" / name).read_text().splitlines()
        assert len(lines) >= 25
        assert lines == (localised[0] / name).read_text().splitlines()[: len(lines)]


@pytest.mark.slow
def test_late_images_are_mapped_where_they_were_taken(scene, localised, tmp_path):
    late, often = ("sensor.delay_s=0.15", "sensor.stamp_error_s=0.01"), "checkpoint.every_steps=5"
    metrics = explore(scene, tmp_path / "run", *late)
    assert metrics.position_rmse_cm < localised[1].position_rmse_cm + 0.5
    assert metrics.observed_f_score > localised[1].observed_f_score - 3.0
    assert metrics.lost_percent == 0.0
    stop = On(Stepped, lambda stepped: stepped.step == 23)
    explore(scene, tmp_path / "cut", *late, often, observers=(stop,))
    resume(tmp_path / "cut")
    for name in ("frames.jsonl", "trajectory.tum", "trajectory_true.tum"):
        assert (tmp_path / "cut" / name).read_text() == (tmp_path / "run" / name).read_text()


@pytest.mark.parametrize("options", [{"settings": ["mapping.engine=torch"]}, {"settings": [], "policy": "anm"}])
def test_an_engine_that_cannot_localise_is_refused_before_anything_is_written(scene, tmp_path, options):
    settings = [*NOISY, *options.pop("settings")]
    preset = "default" if options else "quick"
    config = make_config(preset, settings, scene=str(scene), pose="slam", steps=5, device="cpu", **options)
    with pytest.raises(MapError, match=r"cannot localise; take mapping.engine=native"):
        run(config, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def kidnap(monkeypatch, at_step, forward_m, turn_rad):
    """Move the robot once, without its wheels."""
    act = SimRobot.act

    def moved(self, action):
        if self.step == at_step:
            self._drive._base.place(move_pose(self.pose, forward_m, turn_rad))
        return act(self, action)

    monkeypatch.setattr(SimRobot, "act", moved)


def test_loops_that_close_are_counted(scene, tmp_path, monkeypatch):
    add = KeyframeGraph.add

    def closing(self, *args):
        """As if the second keyframe closed one, which moves nothing."""
        add(self, *args)
        return Correction((0, 1), self.poses, closed=True) if len(self.poses) == 2 else None

    monkeypatch.setattr(KeyframeGraph, "add", closing)
    metrics = explore(scene, tmp_path / "run", steps=12)
    assert metrics.loops_closed == 1
    assert sum(frame.closes_loop for frame in read_run(tmp_path / "run").frames) == 1


@pytest.mark.slow
def test_a_robot_that_somebody_moved_maps_nothing_until_it_knows_where_it_is(scene, tmp_path, monkeypatch):
    kidnap(monkeypatch, 45, 0.0, np.pi / 2)
    seen = []
    metrics = explore(scene, tmp_path / "run", observers=(On(Observed, seen.append),), steps=110)
    lost = [event.observation.step for event in seen if event.estimate.state == "LOST"]
    assert lost
    assert 45 < min(lost) <= 55
    assert all(event.update.num_iterations == 0 for event in seen if event.estimate.state == "LOST")
    assert max(lost) - min(lost) <= 40
    assert metrics.stop_reason != StopReason.LOST
    last = read_run(tmp_path / "run").frames[-1]
    assert np.linalg.norm(last.pose.xy_m - last.true_pose.xy_m) < 0.05
    assert abs(wrap_angle(last.pose.yaw_rad - last.true_pose.yaw_rad)) < 0.02


def test_a_robot_that_is_not_told_where_it_starts_finds_itself_before_it_goes_on(scene, localised, tmp_path):
    seen = []
    metrics = explore(
        scene,
        tmp_path / "run",
        observers=(On(Observed, seen.append),),
        steps=50,
        continue_from=str(localised[0]),
        unknown_start=True,
    )
    found = next(k for k, event in enumerate(seen) if event.estimate.relocalised)
    assert found < 40
    assert all(event.estimate.state == "LOST" for event in seen[:found])
    assert not any(event.update.num_iterations for event in seen[:found])
    assert all(event.estimate.state == "TRACKING" for event in seen[found:])
    frames = read_run(tmp_path / "run").frames
    # It stands elsewhere than the prior run did, and begins at zero.
    assert frames[0].pose.xy_m.tolist() == [0.0, 0.0]
    prior = read_run(localised[0]).frames
    assert np.linalg.norm(frames[0].true_pose.xy_m - prior[0].true_pose.xy_m) > 0.3
    assert json.loads((tmp_path / "run" / "config.json").read_text())["start"] is not None
    for frame in frames[found:]:
        assert np.linalg.norm(frame.pose.xy_m - frame.true_pose.xy_m) < 0.06
        assert abs(wrap_angle(frame.pose.yaw_rad - frame.true_pose.yaw_rad)) < 0.03
    assert metrics.position_rmse_cm is not None
    assert metrics.position_rmse_cm < 6.0
    assert metrics.lost_percent == pytest.approx(100.0 * found / len(frames))
    assert len((tmp_path / "run" / "trajectory.tum").read_text().splitlines()) == len(frames) - found


def test_a_robot_that_does_not_find_itself_ends_lost_and_keeps_the_prior_map(scene, localised, tmp_path):
    never = ["frames=1000", "search_points=10", "headings=4", "candidates=2"]
    settings = [*(f"localisation.relocalisation.{each}" for each in never), "mapping.schedule.final_iterations=0"]
    prior = str(localised[0])
    metrics = explore(
        scene, tmp_path / "run", *settings, steps=300, continue_from=prior, unknown_start=True, return_to_start=True
    )
    assert metrics.stop_reason == StopReason.LOST
    assert metrics.steps == metrics.turns < 120
    assert metrics.lost_percent == 100.0
    assert metrics.position_rmse_cm is None
    assert metrics.return_distance_m is None
    before, after = (read_map(folder / "map.safetensors") for folder in (localised[0], tmp_path / "run"))
    for name, array in before.parameters.items():
        np.testing.assert_array_equal(after.parameters[name], array)
    kept = read_explored(tmp_path / "run" / "explored.safetensors").prior.poses
    np.testing.assert_array_equal(kept, read_explored(localised[0] / "explored.safetensors").prior.poses)


def test_an_unknown_start_needs_a_map_and_localisation(scene, localised, tmp_path):
    for pose, prior in (("slam", None), ("true", str(localised[0]))):
        with pytest.raises(ConfigError, match="add --continue RUN and --pose slam"):
            explore(scene, tmp_path / "run", unknown_start=True, pose=pose, continue_from=prior)
