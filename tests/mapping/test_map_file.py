"""The file of a map: what is written is read."""

from dataclasses import replace

import numpy as np
import pytest
from safetensors.numpy import save

from anm_mj.errors import MapError
from anm_mj.mapping.map_file import SavedMap, read_map, write_map
from anm_mj.mapping.mapping_config import MAPPING_PRESETS
from anm_mj.mapping.neural_map import NeuralMap


@pytest.fixture
def saved():
    parameters = {"table": np.arange(6, dtype=np.float32).reshape(3, 2).T}
    return SavedMap(MAPPING_PRESETS["paper"](), 7, 4, parameters, {"num_frames": np.array(4)})


def assert_same(read, saved):
    assert (read.config, read.seed, read.num_frames) == (saved.config, saved.seed, saved.num_frames)
    for part in ("parameters", "occupancy"):
        found, expected = getattr(read, part), getattr(saved, part)
        assert found.keys() == expected.keys()
        for name, value in expected.items():
            assert found[name].dtype == value.dtype
            assert found[name].shape == value.shape
            np.testing.assert_array_equal(found[name], value)


def test_what_is_written_is_read(saved, tmp_path):
    write_map(tmp_path / "map.safetensors", saved)
    assert_same(read_map(tmp_path / "map.safetensors"), saved)


def test_a_run_that_went_on_beyond_all_schedules_is_read(saved, tmp_path):
    went_on = replace(saved, num_frames=10**18)
    write_map(tmp_path / "map.safetensors", went_on)
    assert read_map(tmp_path / "map.safetensors").num_frames == 10**18


def test_a_map_of_blind_frames_is_as_untrained_as_before(tiny_config, room, tmp_path):
    blind = NeuralMap(tiny_config, seed=0, device="cpu")
    view = room.observe(1.5, 1.5, 0.0)
    blind.integrate(replace(view, depth_m=np.full_like(view.depth_m, np.nan)))
    blind.save(tmp_path / "map.safetensors")
    assert not blind.is_trained
    assert not NeuralMap.load(tmp_path / "map.safetensors", device="cpu").is_trained


def test_the_same_map_gives_the_same_bytes(saved, tmp_path):
    for name in "ab":
        write_map(tmp_path / name, saved)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_damaged_file_is_refused(tmp_path):
    (tmp_path / "foreign.safetensors").write_bytes(b"not a map")
    with pytest.raises(MapError, match=r"give the map\.safetensors"):
        read_map(tmp_path / "foreign.safetensors")


def test_arrays_of_another_program_are_refused(tmp_path):
    (tmp_path / "other.safetensors").write_bytes(save({"weights": np.zeros(3, np.float32)}))
    with pytest.raises(MapError, match="holds None, not 'anm-mj map 3'"):
        read_map(tmp_path / "other.safetensors")
