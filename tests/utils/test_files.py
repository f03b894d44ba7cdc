import numpy as np
import pytest
import safetensors.numpy
from safetensors import SafetensorError

from anm_mj.utils.files import write_tensors
from anm_mj.utils.read_file import read_tensors


def test_a_file_is_read_back_and_may_be_read_by_whom_any_other_file_may(tmp_path):
    arrays = {"a": np.arange(6.0).reshape(2, 3), "b": np.array(7, np.int64)}
    write_tensors(tmp_path / "x.safetensors", arrays, {"said": "so"})
    said, found = read_tensors(tmp_path / "x.safetensors")
    assert said == {"said": "so"}
    assert all(np.array_equal(found[name], array) for name, array in arrays.items())
    (tmp_path / "other").touch()
    assert (tmp_path / "x.safetensors").stat().st_mode == (tmp_path / "other").stat().st_mode


def test_an_error_of_the_library_is_one_of_the_system(tmp_path, monkeypatch):
    def full(*_):
        raise SafetensorError("No space left on device")

    monkeypatch.setattr(safetensors.numpy, "save_file", full)
    with pytest.raises(OSError, match="No space left on device"):
        write_tensors(tmp_path / "x.safetensors", {}, {})
