"""A map that goes on from a prior run: it knows what was there, and notices what is not."""

import dataclasses

import numpy as np
import pytest

from anm_mj.errors import MapError
from anm_mj.mapping.keyframes import Keyframes, KeyframeStore
from anm_mj.mapping.map_file import read_map
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.mapping.prior_surface import MIN_VOXELS, PriorSurface
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from tests.mapping.ray_room import TABLE, Room

BOX = (np.array([1.0, 2.3, 0.0]), np.array([1.5, 2.8, 0.8]))
NOTHING = Keyframes.of(KeyframeStore(1_000_000, 1.0).keyframes().arrays())
PLACES = [(1.2, 1.4), (2.2, 0.6)]


def look_around(neural_map, room):
    step = 0
    for x, y in PLACES:
        for observation in room.turn(x, y, 12):
            neural_map.integrate(observation)
            step += 1


def continued(path, config, replay=None):
    saved = read_map(path / "map.safetensors")
    neural_map = NeuralMap(config, seed=1, device="cpu")
    neural_map.continue_from(saved, replay or Keyframes.of(dict(np.load(path / "replay.npz"))))
    return neural_map


@pytest.fixture(scope="module")
def prior(tmp_path_factory, tiny_config):
    """The map of a room with a table."""
    path = tmp_path_factory.mktemp("prior")
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    look_around(neural_map, Room((TABLE,)))
    neural_map.save(path / "map.safetensors")
    np.savez(path / "replay.npz", **neural_map.replay(500_000).arrays())
    return path


def test_a_continued_map_is_the_former_one(prior, tiny_config):
    loaded, now = NeuralMap.load(prior / "map.safetensors", device="cpu"), continued(prior, tiny_config)
    points = np.random.default_rng(0).uniform(0.2, 2.0, (200, 3))
    np.testing.assert_array_equal(now.sdf(points), loaded.sdf(points))
    np.testing.assert_array_equal(now.occupancy_grid().state, loaded.occupancy_grid().state)
    assert now.changes() == ()
    assert loaded.changes() is None


def test_nothing_is_marked_where_nothing_has_changed(prior, tiny_config):
    now = continued(prior, tiny_config)
    look_around(now, Room((TABLE,)))
    assert now.changes() == ()
    # Nothing of the prior run was dropped, so every place is replayed still.
    assert now.replay(10**9).num_pixels[: len(continued(prior, tiny_config).replay(10**9))].min() > 100


def test_a_table_that_is_gone_and_a_box_that_is_new_are_marked_and_learnt(prior, tiny_config):
    now = continued(prior, tiny_config)
    room = Room((BOX,))
    look_around(now, room)
    changes = now.changes()
    assert {change.kind for change in changes} == {"gone", "new"}
    for kind, (low, high) in (("gone", TABLE), ("new", BOX)):
        marked = np.concatenate([change.xyz_m for change in changes if change.kind == kind])
        assert ((marked >= low - 0.06) & (marked <= high + 0.06)).all()
        assert len(marked) > 40
    # The mesh has neither the table's top nor its sides any more, and it has the box.
    vertices = np.asarray(now.mesh(0.05).vertices)
    table = ((vertices > TABLE[0] + 0.05) & (vertices < TABLE[1] + 0.08) & (vertices[:, 2:] > 0.3)).all(axis=1)
    box = (
        (np.abs(room.sdf(vertices)) < 0.05) & (vertices[:, 1] < 2.7) & (vertices[:, 1] > 2.25) & (vertices[:, 2] > 0.2)
    )
    assert table.sum() == 0
    assert box.sum() > 20


def test_pixels_that_are_contradicted_are_not_replayed(prior, tiny_config):
    now = continued(prior, tiny_config)
    before = now.replay(10**9)
    look_around(now, Room((BOX,)))
    after = now.replay(10**9)
    count = len(before.pixels)
    old = after.pixels[: np.cumsum(after.num_pixels)[len(before) - 1]]
    assert 0.5 * count < len(old) < 0.99 * count


def test_a_store_that_is_full_thins_what_is_replayed_of_the_prior_run(prior, tiny_config):
    """Thinned or not, the pixels on what is gone are dropped."""
    replay = Keyframes.of(dict(np.load(prior / "replay.npz")))
    schedule = dataclasses.replace(tiny_config.schedule, replay_bytes=1_000_000)
    now = continued(prior, dataclasses.replace(tiny_config, schedule=schedule), replay)
    look_around(now, Room(()))
    after = now.replay(10**9)
    num_old = int(after.num_pixels[: len(replay)].sum())
    assert 0.05 * len(replay.pixels) < num_old < 0.49 * len(replay.pixels)
    assert any(change.kind == "gone" for change in now.changes())


def test_a_few_views_change_what_many_have_found(prior, tiny_config):
    now = continued(prior, tiny_config)
    top = np.array([[3.0, 1.2, 0.7]])
    assert now.occupancy.by_depth.state_at(top) == OCCUPIED
    for _ in range(6):
        now.integrate(Room(()).observe(1.5, 1.4, 0.0))
    assert now.occupancy.by_depth.state_at(top) == FREE


def grid(state, version=1):
    columns = np.full((state.shape[1] // 16, state.shape[2] // 16), version, np.int32)
    return OccupancyGrid(state, np.zeros(state.shape, np.float32), np.zeros(3), 0.05, version, columns)


def test_a_surface_that_falls_into_the_next_voxel_is_no_change():
    state = np.full((16, 32, 32), FREE, np.int8)
    state[5] = OCCUPIED
    prior = PriorSurface(grid(state), np.zeros(3, np.int64), NOTHING)
    moved = np.full_like(state, FREE)
    moved[6] = OCCUPIED
    assert prior.changes(moved, moved, np.zeros(3, np.int64)) == ()
    moved[6], moved[8] = FREE, OCCUPIED
    assert [change.kind for change in prior.changes(moved, moved, np.zeros(3, np.int64))] == ["gone", "new"]


def test_small_and_unseen_changes_are_not_told():
    state = np.full((16, 32, 32), FREE, np.int8)
    state[:, :, 20:] = UNKNOWN
    prior = PriorSurface(grid(state), np.zeros(3, np.int64), NOTHING)
    now = state.copy()
    now[:, :, 24:] = OCCUPIED
    now[4, 4, : MIN_VOXELS - 1] = OCCUPIED
    assert prior.changes(now, now, np.zeros(3, np.int64)) == ()
    now[4, 4, :MIN_VOXELS] = OCCUPIED
    (change,) = prior.changes(now, now, np.zeros(3, np.int64))
    assert change.kind == "new"
    np.testing.assert_allclose(change.box_m, [[-0.025, 0.175, 0.175], [0.05 * MIN_VOXELS - 0.025, 0.225, 0.225]])
    store = KeyframeStore(1_000_000, 1.0)
    prior.forget_contradicted(store, grid(now), np.zeros(3, np.int64))
    assert len(store) == 0


def test_the_grid_may_grow_to_all_sides():
    state = np.full((16, 16, 16), FREE, np.int8)
    prior = PriorSurface(grid(state), np.array([16, 0, -16]), NOTHING)
    grown = np.full((32, 32, 48), UNKNOWN, np.int8)
    grown[16:, 16:, 16:32] = FREE
    grown[20:24, 20:24, 20:24] = OCCUPIED
    (change,) = prior.changes(grown, grown, np.array([0, -16, -32]))
    np.testing.assert_allclose(change.box_m[0], [0.05 * 20 - 0.025, 0.05 * 4 - 0.025, 0.05 * -12 - 0.025])


@pytest.mark.parametrize("spoil", ["pixels", "num_pixels", "cameras", "type", "nan", "huge"])
def test_damaged_keyframes_are_refused(prior, spoil):
    arrays = dict(np.load(prior / "replay.npz"))
    if spoil == "type":
        arrays["pixels"] = arrays["pixels"].astype(np.int16)
    elif spoil == "nan":
        arrays["cameras"][0, 3] = np.nan
    elif spoil == "huge":
        arrays["num_pixels"][0] = 2**62
    else:
        arrays[spoil] = arrays[spoil][:-1]
    with pytest.raises(MapError, match="keyframes"):
        Keyframes.of(arrays)
    with pytest.raises(MapError, match="keyframes"):
        Keyframes.of({})
