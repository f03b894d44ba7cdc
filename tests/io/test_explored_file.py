import numpy as np
import pytest

from anm_mj.errors import RunFolderError
from anm_mj.io.explored_file import Explored, read_explored, write_explored
from anm_mj.types import ExploredState

POSES = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]])
PRIOR = ExploredState("own:Policy", POSES, POSES[:0], {"grid": np.arange(6.0).reshape(2, 3)})
REPLAY = {"pixels": np.zeros((4, 9), np.uint8), "num_pixels": np.array([4])}


def test_what_is_written_is_read(tmp_path):
    path = tmp_path / "explored.safetensors"
    write_explored(path, Explored(PRIOR, REPLAY))
    found = read_explored(path)
    assert found.prior.policy == "own:Policy"
    np.testing.assert_array_equal(found.prior.poses, POSES)
    assert found.prior.collisions.shape == (0, 3)
    np.testing.assert_array_equal(found.prior.memory["grid"], PRIOR.memory["grid"])
    np.testing.assert_array_equal(found.replay["pixels"], REPLAY["pixels"])
    again = tmp_path / "again.safetensors"
    write_explored(again, found)
    assert again.read_bytes() == path.read_bytes()


def test_a_missing_file_is_said_with_what_to_do(tmp_path):
    with pytest.raises(RunFolderError, match=r"has no explored.safetensors.*--resume.*replay_bytes"):
        read_explored(tmp_path / "explored.safetensors")


@pytest.mark.parametrize("spoil", ["cut", "text", "format", "poses", "nan", "shape"])
def test_a_damaged_file_is_one_sentence(tmp_path, spoil):
    from safetensors.numpy import save

    path = tmp_path / "explored.safetensors"
    write_explored(path, Explored(PRIOR, REPLAY))
    if spoil == "cut":
        path.write_bytes(path.read_bytes()[:-20])
    elif spoil == "text":
        path.write_text("what?")
    elif spoil == "format":
        path.write_bytes(save({"poses": POSES, "refused": POSES}))
    else:
        poses = {"poses": {}, "nan": {"poses": POSES * np.nan}, "shape": {"poses": POSES[0]}}[spoil]
        path.write_bytes(save({"refused": POSES, **poses}, {"anm_mj": '{"format": "anm-mj explored 1"}'}))
    with pytest.raises(RunFolderError, match="cannot be read"):
        read_explored(path)


@pytest.mark.parametrize(("poses", "words"), [(POSES + 1e30, "beyond 1000 km"), (np.zeros((200_001, 3)), "200001")])
def test_poses_beyond_everything_are_refused(tmp_path, poses, words):
    path = tmp_path / "explored.safetensors"
    write_explored(path, Explored(ExploredState("p", poses, POSES, {}), REPLAY))
    with pytest.raises(RunFolderError, match=words):
        read_explored(path)
