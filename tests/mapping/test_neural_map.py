import inspect
import math
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.errors import MapError
from anm_mj.mapping import field
from anm_mj.mapping.field import MAX_FAILURES
from anm_mj.mapping.mapping_config import MAPPING_PRESETS, FieldConfig
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Intrinsics, Observation, Pose2, TrainingEffort
from tests.mapping.ray_room import Room, camera_pose


def _near_surface(room, rng, count=2000):
    """Points within 5 cm of the walls that the camera in the middle has seen."""
    points = rng.uniform([0.0, 0.3, 0.4], [2.2, 2.7, 2.0], (count, 3))
    points[: count // 2, 0] = rng.uniform(0.0, 0.05, count // 2)
    points[count // 2 :, 1] = rng.uniform(2.95, 3.0, count - count // 2)
    return points


def test_the_sdf_is_learnt_to_within_two_centimetres_near_walls(trained_map, room):
    points = _near_surface(room, np.random.default_rng(0))
    assert np.abs(trained_map.sdf(points) - room.sdf(points)).mean() < 0.02


def test_observed_free_space_is_positive(trained_map, room):
    rng = np.random.default_rng(0)
    points = rng.uniform([0.2, 0.2, 0.5], [2.4, 2.8, 2.2], (3000, 3))
    points = points[room.sdf(points) > 0.12]
    values = trained_map.sdf(points)
    assert (values > 0.0).mean() > 0.995
    assert values.max() <= np.float32(0.1)


def test_colours_are_learnt(trained_map, room):
    points = _near_surface(room, np.random.default_rng(1), 200)
    assert np.abs(trained_map.rgb(points) - room.color(points)).mean() < 0.1


def test_the_rendered_view_looks_like_the_seen_one(trained_map, room):
    observation = room.observe(1.5, 1.5, 2.0, size=32)
    rgb, depth = trained_map.render(observation.intrinsics, observation.T_world_camera)
    seen = np.isfinite(depth)
    assert seen.mean() > 0.98
    assert np.median(np.abs(depth - observation.depth_m)[seen]) < 0.03
    assert np.abs(rgb.astype(float) - observation.rgb)[seen].mean() < 25.0


def test_same_seed_and_views_give_the_same_map_bit_for_bit(tiny_config, room):
    maps = []
    for _ in range(2):
        neural_map = NeuralMap(tiny_config, seed=4, device="cpu")
        for observation in room.turn(1.5, 1.5, 12)[:3]:
            neural_map.integrate(observation)
        maps.append(neural_map)
    first, second = (m.backend.parameters() for m in maps)
    for name in first:
        np.testing.assert_array_equal(first[name], second[name])
    np.testing.assert_array_equal(maps[0].occupancy_grid().state, maps[1].occupancy_grid().state)


def test_the_schedule_counts_iterations_and_keyframes(tiny_config, room):
    schedule = replace(tiny_config.schedule, first_iterations=3, iterations=2, train_every=3, keyframe_every=2)
    neural_map = NeuralMap(replace(tiny_config, schedule=schedule), seed=0, device="cpu")
    updates = [neural_map.integrate(o) for o in room.turn(1.5, 1.5, 12)[:7]]
    assert [u.num_iterations for u in updates] == [3, 0, 0, 2, 0, 0, 2]
    assert [u.num_keyframes for u in updates] == [1, 1, 2, 2, 3, 3, 4]
    assert math.isnan(updates[1].loss)
    assert math.isfinite(updates[3].loss)


@pytest.mark.parametrize("geometry", ["occupancy", "field"])
def test_sky_makes_no_surface(tiny_config, geometry):
    room = Room(ceiling=False)
    neural_map = NeuralMap(replace(tiny_config, geometry=geometry), seed=0, device="cpu")
    for observation in room.turn(1.5, 1.5, 8, size=128):
        neural_map.integrate(observation)
    grid = neural_map.occupancy_grid()
    occupied = grid.origin_m + (np.argwhere(grid.state == OCCUPIED)[:, ::-1] + 0.5) * grid.resolution_m
    if geometry == "field":
        # Beside an open edge the field decides to within a voxel.
        assert occupied[:, 2].max() < 2.4 + 0.05 + 1e-6
    else:
        assert occupied[:, 2].max() < 2.4 + 0.05
    assert neural_map.mesh(0.05).vertices[:, 2].max() < 2.5
    assert neural_map.surface(np.array([1.5, 1.5]), 10.0).xyz_m[:, 2].max() < 2.5
    rng = np.random.default_rng(0)
    above = rng.uniform([2.8, 1.0, 2.6], [3.2, 2.0, 2.8], (3000, 3))
    state = neural_map.occupancy.by_depth.state_at(above)
    assert (state == FREE).any()
    assert (neural_map.sdf(above[state == FREE]) > 0.0).mean() > 0.95


def test_save_and_load_answer_the_same(trained_map, tmp_path):
    path = str(tmp_path / "map.safetensors")
    trained_map.save(path)
    loaded = NeuralMap.load(path, device="cpu")
    assert loaded.config == trained_map.config
    points = np.random.default_rng(0).uniform(-1.0, 4.0, (500, 3))
    np.testing.assert_array_equal(loaded.sdf(points), trained_map.sdf(points))
    np.testing.assert_array_equal(loaded.rgb(points), trained_map.rgb(points))
    np.testing.assert_array_equal(loaded.uncertainty(points), trained_map.uncertainty(points))
    for name in ("state", "seen_range_m", "origin_m"):
        np.testing.assert_array_equal(
            getattr(loaded.occupancy_grid(), name), getattr(trained_map.occupancy_grid(), name)
        )
    assert len(loaded.mesh(0.1).faces) == len(trained_map.mesh(0.1).faces)


@pytest.mark.parametrize("effort", [None, TrainingEffort(4, None, False)])
def test_a_loaded_map_takes_in_views_between_keyframes(tiny_config, room, tmp_path, effort):
    config = replace(tiny_config, schedule=replace(tiny_config.schedule, keyframe_every=5))
    neural_map = NeuralMap(config, seed=0, device="cpu")
    for observation in room.turn(1.5, 1.5, 2):
        neural_map.integrate(observation)
    neural_map.save(tmp_path / "map.safetensors")
    loaded = NeuralMap.load(tmp_path / "map.safetensors", device="cpu")
    for step in (2, 3):
        assert loaded.integrate(room.observe(1.5, 1.5, 0.1, step=step), effort).num_iterations > 0
    assert len(loaded.field.keyframes) == 1


def test_a_loaded_map_takes_in_more_views(trained_map, room, tmp_path):
    path = tmp_path / "map.safetensors"
    trained_map.save(path)
    loaded = NeuralMap.load(path, device="cpu")
    update = loaded.integrate(room.observe(1.5, 1.5, 0.1, step=12))
    assert update.num_iterations == trained_map.config.schedule.iterations
    assert math.isfinite(update.loss)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(MapError, match="no map at"):
        NeuralMap.load(tmp_path / "map.safetensors")


def spoilt(neural_map, name="sdf_out"):
    """Parameters become NaN, as a step too far makes them."""
    state = neural_map.backend.parameters()
    state[name][:] = np.nan
    neural_map.backend.set_parameters(state)


def test_a_loss_that_is_not_finite_takes_the_map_back_to_the_last_good_state(tiny_config, room, caplog):
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    views = room.turn(1.5, 1.5, 12)
    for observation in views[:6]:
        neural_map.integrate(observation)
    good = neural_map.backend.parameters()
    neural_map.field._keep_or_restore(5)
    spoilt(neural_map, "sdf_out")
    update = neural_map.integrate(views[6])
    assert math.isnan(update.loss)
    assert update.num_iterations == 0
    assert "at step 6; the map goes back to what it was 1 frames ago" in caplog.text
    for key, value in neural_map.backend.parameters().items():
        np.testing.assert_array_equal(value, good[key])
    for observation in views[7:]:
        assert math.isfinite(neural_map.integrate(observation).loss)
    points = _near_surface(room, np.random.default_rng(0), 500)
    assert np.abs(neural_map.sdf(points) - room.sdf(points)).mean() < 0.03


def test_features_that_are_not_finite_are_found_before_the_loss_shows_them(tiny_config, room, monkeypatch, caplog):
    """The activations of the decoders may turn them into zeros."""
    monkeypatch.setattr(field, "KEEP_EVERY_FRAMES", 2)
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    views = room.turn(1.5, 1.5, 6)
    for observation in views[:3]:
        neural_map.integrate(observation)
    spoilt(neural_map, "table")
    for observation in views[3:]:
        neural_map.integrate(observation)
    assert "not finite any more at step" in caplog.text or "; the map goes back" in caplog.text
    assert np.isfinite(neural_map.backend.parameters()["table"]).all()


def test_parameters_that_nothing_reads_are_found_too(tiny_config, room, caplog):
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    views = room.turn(1.5, 1.5, 3)
    neural_map.integrate(views[0])
    state = neural_map.backend.parameters()
    state["table"][-1, 0] = np.inf
    neural_map.backend.set_parameters(state)
    stored = neural_map.field.get_state()
    assert np.isfinite(stored["table"]).all()
    assert "Parameters of the map were not finite any more" in caplog.text


def test_a_loss_that_is_never_finite_ends_with_step_and_value(tiny_config, room, monkeypatch, tmp_path):
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    views = room.turn(1.5, 1.5, MAX_FAILURES + 1)
    neural_map.integrate(views[0])
    steps = neural_map.backend.steps
    monkeypatch.setattr(
        neural_map.backend, "steps", lambda *_: [losses._replace(total=math.inf) for losses in steps(*_)]
    )
    for observation in views[1:-1]:
        assert math.isnan(neural_map.integrate(observation).loss)
    with pytest.raises(
        MapError, match=f"became inf .* at step {MAX_FAILURES}, as in the {MAX_FAILURES - 1} frames before"
    ):
        neural_map.integrate(views[-1])
    neural_map.save(tmp_path / "map.safetensors")
    assert NeuralMap.load(tmp_path / "map.safetensors", device="cpu").sdf(np.zeros((1, 3))).shape == (1,)


def test_a_final_training_that_fails_leaves_the_map_as_it_was(tiny_config, room, monkeypatch, caplog):
    config = replace(tiny_config, schedule=replace(tiny_config.schedule, final_iterations=40))
    neural_map = NeuralMap(config, seed=0, device="cpu")
    neural_map.integrate(room.turn(1.5, 1.5, 1)[0])
    before = neural_map.backend.parameters()
    kind = type(neural_map.backend)
    steps = kind.steps
    monkeypatch.setattr(kind, "steps", lambda *_: [losses._replace(total=math.nan) for losses in steps(*_)])
    assert neural_map.finish() == 0
    assert "The loss of the final training became nan" in caplog.text
    for key, value in neural_map.backend.parameters().items():
        np.testing.assert_array_equal(value, before[key])


@pytest.mark.parametrize("iterations", [0, 3, 6])
def test_the_final_training_has_as_many_iterations_as_it_is_told(tiny_config, room, monkeypatch, iterations):
    config = replace(tiny_config, schedule=replace(tiny_config.schedule, final_iterations=iterations))
    neural_map = NeuralMap(config, seed=0, device="cpu")
    neural_map.integrate(room.turn(1.5, 1.5, 1)[0])
    kind, done = type(neural_map.backend), []
    steps = kind.steps
    monkeypatch.setattr(kind, "steps", lambda *_: done.extend(losses := list(steps(*_))) or losses)
    assert neural_map.finish() == iterations == len(done)


def test_what_was_learnt_stays_where_it_was_when_the_world_grows(tiny_config, room):
    # Coordinates are metric, so a far view changes shared weights a little but moves no feature.
    neural_map = NeuralMap(
        replace(tiny_config, field=FieldConfig(num_levels=8, log2_table_size=14)), seed=0, device="cpu"
    )
    for observation in room.turn(1.5, 1.5, 8):
        neural_map.integrate(observation)
    points = _near_surface(room, np.random.default_rng(0), 500)
    before = neural_map.sdf(points)
    far = room.observe(1.5, 1.5, 0.0, step=8)
    far.T_world_camera[:2, 3] += 30.0
    neural_map.integrate(far)
    assert np.abs(neural_map.sdf(points) - before).mean() < 0.02


@pytest.mark.parametrize("engine", ["torch", "native"])
def test_the_table_grows_with_the_scene_and_every_place_keeps_what_was_learnt(tiny_config, room, engine, monkeypatch):
    field = replace(tiny_config.field, log2_table_size=10, largest_log2_table_size=12, entries_per_m3=90.0)
    neural_map = NeuralMap(replace(tiny_config, field=field, engine=engine), seed=0, device="cpu")
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.0, 5.0, (500, 3))
    sizes, moved = [], []
    fit_table = neural_map.field.fit_table

    def fit_and_compare(volume_m3):
        before = neural_map.sdf(points)
        fit_table(volume_m3)
        moved.append(np.abs(neural_map.sdf(points) - before).max())

    monkeypatch.setattr(neural_map.field, "fit_table", fit_and_compare)
    for observation in room.turn(1.5, 1.5, 8):
        neural_map.integrate(observation)
        sizes.append(neural_map.config.field.log2_table_size)
    assert (sizes[0], sizes[-1]) == (11, 12)
    assert sizes == sorted(sizes)
    assert max(moved) == 0.0
    volume = neural_map.occupancy.by_depth.surface_volume_m3()
    assert 1 << 11 < 90.0 * volume <= 1 << 12
    near = _near_surface(room, rng, 500)
    assert np.abs(neural_map.sdf(near) - room.sdf(near)).mean() < 0.03


def test_a_table_that_may_not_grow_keeps_its_size(tiny_config, room):
    field = replace(tiny_config.field, log2_table_size=10, largest_log2_table_size=8, entries_per_m3=1e6)
    neural_map = NeuralMap(replace(tiny_config, field=field), seed=0, device="cpu")
    neural_map.integrate(room.observe(1.5, 1.5, 0.0))
    assert neural_map.config.field.log2_table_size == 10


def test_a_grown_map_is_saved_and_loaded_at_its_size(tiny_config, room, tmp_path):
    field = replace(tiny_config.field, log2_table_size=10, largest_log2_table_size=11, entries_per_m3=1e6)
    neural_map = NeuralMap(replace(tiny_config, field=field), seed=0, device="cpu")
    neural_map.integrate(room.observe(1.5, 1.5, 0.0))
    neural_map.save(tmp_path / "map.safetensors")
    loaded = NeuralMap.load(tmp_path / "map.safetensors", device="cpu")
    points = np.random.default_rng(0).uniform(0.0, 3.0, (100, 3))
    assert loaded.config.field.log2_table_size == 11
    np.testing.assert_array_equal(loaded.sdf(points), neural_map.sdf(points))


@pytest.mark.parametrize("value", [np.nan, 0.0, -1.0])
def test_blind_frames_do_no_harm(tiny_config, room, value):
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    for observation in room.turn(1.5, 1.5, 12):
        neural_map.integrate(observation)
        neural_map.integrate(replace(observation, depth_m=np.full_like(observation.depth_m, value)))
    points = _near_surface(room, np.random.default_rng(0))
    assert np.abs(neural_map.sdf(points) - room.sdf(points)).mean() < 0.02
    vertices = neural_map.mesh(0.05).vertices
    assert (np.abs(room.sdf(vertices)) < 0.05).mean() > 0.9
    assert (np.abs(vertices[:, 0]) < 0.05).sum() > 500


def test_first_frame_may_be_blind(tiny_config, room):
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    first, second = room.turn(1.5, 1.5, 2)
    update = neural_map.integrate(replace(first, depth_m=np.full_like(first.depth_m, np.nan)))
    assert (update.num_iterations, update.num_keyframes) == (0, 0)
    assert neural_map.occupancy_grid().state.size > 0
    assert (neural_map.occupancy_grid().state == UNKNOWN).all()
    assert neural_map.integrate(second).num_keyframes == 1


def test_every_iteration_gets_the_rays_that_the_schedule_asks_for(tiny_config, room, monkeypatch):
    config = replace(
        tiny_config, schedule=replace(tiny_config.schedule, first_iterations=13, iterations=12, num_rays=40)
    )
    neural_map = NeuralMap(config, seed=0, device="cpu")
    sizes = []
    steps = neural_map.backend.steps

    def counting(batches, draws):
        batches = list(batches)
        sizes.extend(len(rays.depth_m) for rays in batches)
        return steps(batches, draws)

    monkeypatch.setattr(neural_map.backend, "steps", counting)
    neural_map.integrate(room.observe(1.5, 1.5, 0.0))
    neural_map.integrate(room.observe(1.5, 1.5, 0.5, step=1))
    # The second of two keyframes brings half as many rays of its own, 26 at least.
    assert sizes == [40] * 13 + [40 + 26] * 12


def settled(config, room, iterations, frames=6):
    """A map of some views after its final training."""
    neural_map = NeuralMap(
        replace(config, schedule=replace(config.schedule, final_iterations=iterations)), seed=4, device="cpu"
    )
    for observation in room.turn(1.5, 1.5, frames):
        neural_map.integrate(observation)
    return neural_map, neural_map.finish()


def test_the_final_training_settles_the_map(tiny_config, room):
    points = _near_surface(room, np.random.default_rng(0))
    before, none = settled(tiny_config, room, 0)
    after, count = settled(tiny_config, room, 80)
    assert (none, count) == (0, 80)
    errors = [np.abs(m.sdf(points) - room.sdf(points)).mean() for m in (before, after)]
    assert errors[1] < 0.95 * errors[0]
    assert after.config.optimizer == tiny_config.optimizer
    again, _ = settled(tiny_config, room, 80)
    np.testing.assert_array_equal(again.sdf(points), after.sdf(points))


@pytest.mark.parametrize("final", [0, 40])
def test_a_map_knows_whether_anything_trained_it(tiny_config, room, tmp_path, final):
    schedule = replace(tiny_config.schedule, first_iterations=0, iterations=0)
    neural_map, _ = settled(replace(tiny_config, schedule=schedule), room, final, frames=1)
    assert neural_map.is_trained == (final > 0)
    neural_map.save(tmp_path / "map.safetensors")
    assert NeuralMap.load(tmp_path / "map.safetensors", device="cpu").is_trained == (final > 0)


def test_an_empty_map_has_no_final_training(tiny_config):
    assert NeuralMap(tiny_config, seed=0, device="cpu").finish() == 0


def test_expected_errors_fall_with_observations(tiny_config, room):
    neural_map, observation = NeuralMap(tiny_config, seed=4, device="cpu"), room.turn(1.5, 1.5, 12)[0]
    neural_map.integrate(observation)
    once = neural_map.surface_errors(np.array([1.5, 1.5]), 5.0)
    for _ in range(8):
        neural_map.integrate(observation)
    often = neural_map.surface_errors(np.array([1.5, 1.5]), 5.0)
    assert len(once.xyz_m) == len(once.error_m) == len(once.num_observations) > 50
    assert often.num_observations.mean() > 4.0 * once.num_observations.mean()
    assert often.error_m.mean() < 0.8 * once.error_m.mean()
    assert 0.0 < often.exponent < 1.0


def test_lost_pixels_look_through_up_to_the_range_that_images_have_shown(tiny_config):
    """A long hall that a camera loses beyond 6 m, although its maker says 10 m."""
    camera = Intrinsics.from_fov(128, 128, math.pi / 2)
    down = np.maximum((np.arange(128) + 0.5 - camera.cy) / camera.fy, 1e-6)
    depth_m = np.repeat((1.0 / down)[:, None], 128, axis=1).astype(np.float32)
    depth_m[depth_m > 6.0] = np.nan
    T_world_camera = camera_pose(0.0, 0.0, 1.0, 0.0)
    rgb = np.zeros((128, 128, 3), np.uint8)
    seen = Observation(0, 0.0, rgb, depth_m, camera, T_world_camera, Pose2(0.0, 0.0, 0.0), range_m=10.0)
    for shown_m, state in ((math.inf, UNKNOWN), (6.0, FREE)):
        learnt = NeuralMap(tiny_config, seed=0, device="cpu")
        learnt.integrate(replace(seen, shown_range_m=shown_m))
        assert learnt.occupancy.by_depth.state_at(np.array([[4.0, 0.0, 1.0]]))[0] == state


@pytest.mark.parametrize(
    ("name", "image", "said"),
    [
        ("rgb", np.zeros((4, 5, 3)), "rgb of observation 7 is float64 of shape .4, 5, 3.;.* give uint8"),
        ("rgb", np.zeros((8, 10, 3), np.uint8), r"shape .8, 10, 3.;.* of shape .4, 5, 3."),
        ("rgb", np.zeros((4, 5), np.uint8), r"shape .4, 5.;"),
        ("depth_m", np.ones((4, 5)), "depth_m of observation 7 is float64 .* give float32"),
        ("depth_m", np.ones((5, 4), np.float32), "depth_m .* of shape .5, 4.;"),
    ],
)
def test_images_of_another_type_or_size_are_refused(name, image, said):
    camera = Intrinsics.from_fov(5, 4, math.radians(90.0))
    rgb, depth_m = np.zeros((4, 5, 3), np.uint8), np.ones((4, 5), np.float32)
    observation = Observation(7, 0.0, rgb, depth_m, camera, np.eye(4), Pose2(0.0, 0.0, 0.0))
    # The tests' own check of types would not let it be made with them.
    object.__setattr__(observation, name, image)
    with pytest.raises(MapError, match=said):
        NeuralMap(MAPPING_PRESETS["quick"](), seed=0, device="cpu").integrate(observation)


@pytest.mark.parametrize("shape", [(3,), (4, 2), (2, 2, 3)])
def test_what_is_no_array_of_points_is_refused(tiny_config, shape):
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    for ask in (NeuralMap.sdf, NeuralMap.rgb, NeuralMap.uncertainty):
        # Without the tests' own check of types.
        with pytest.raises(MapError, match=r"Points are an array of shape \(n, 3\)"):
            inspect.unwrap(ask)(neural_map, np.zeros(shape))
