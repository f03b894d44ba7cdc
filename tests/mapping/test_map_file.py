"""The file of a map: what is written is read, and what older versions wrote."""

from dataclasses import asdict

import numpy as np
import pytest
import torch
from safetensors.numpy import save

from anm_mj.errors import MapError
from anm_mj.mapping.map_file import SavedMap, read_map, write_map
from anm_mj.mapping.mapping_config import MAPPING_PRESETS


@pytest.fixture
def saved():
    arrays = {"field.table": np.arange(6, dtype=np.float32).reshape(3, 2).T, "occupancy.num_frames": np.array(4)}
    return SavedMap(MAPPING_PRESETS["paper"](), 7, 4, arrays)


def assert_same(read, saved):
    assert (read.config, read.seed, read.num_frames) == (saved.config, saved.seed, saved.num_frames)
    assert read.arrays.keys() == saved.arrays.keys()
    for name, value in saved.arrays.items():
        assert read.arrays[name].dtype == value.dtype
        assert read.arrays[name].shape == value.shape
        np.testing.assert_array_equal(read.arrays[name], value)


def test_what_is_written_is_read(saved, tmp_path):
    write_map(tmp_path / "map.safetensors", saved)
    assert_same(read_map(tmp_path / "map.safetensors"), saved)


def test_the_same_map_gives_the_same_bytes(saved, tmp_path):
    for name in "ab":
        write_map(tmp_path / name, saved)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_an_archive_of_an_older_version_is_read(saved, tmp_path):
    content = {
        "format": "anm-mj map 2",
        "config": asdict(saved.config),
        "seed": saved.seed,
        "num_frames": saved.num_frames,
        "arrays": {name: torch.from_numpy(value.copy()) for name, value in saved.arrays.items()},
    }
    torch.save(content, tmp_path / "map.pt")
    assert_same(read_map(tmp_path / "map.pt"), saved)


@pytest.mark.parametrize("name", ["foreign.pt", "foreign.safetensors"])
def test_a_damaged_file_is_refused(name, tmp_path):
    (tmp_path / name).write_bytes(b"not a map")
    with pytest.raises(MapError, match=r"give the map\.safetensors"):
        read_map(tmp_path / name)


def test_arrays_of_another_program_are_refused(tmp_path):
    (tmp_path / "other.safetensors").write_bytes(save({"weights": np.zeros(3, np.float32)}))
    with pytest.raises(MapError, match="holds None, not 'anm-mj map 3'"):
        read_map(tmp_path / "other.safetensors")


class _Code:
    def __reduce__(self):
        return (print, ("executed",))


def test_an_archive_executes_nothing(tmp_path, capsys):
    torch.save({"format": "anm-mj map 2", "config": _Code()}, tmp_path / "map.pt")
    with pytest.raises(MapError, match="cannot be read"):
        read_map(tmp_path / "map.pt")
    assert "executed" not in capsys.readouterr().out
