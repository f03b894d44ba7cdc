import numpy as np
import pytest

from anm_mj.errors import RunFolderError
from anm_mj.io.changes_file import read_changes, write_changes
from anm_mj.types import SurfaceChange

TABLE = SurfaceChange("gone", np.array([[0.0, 1.0, 0.5], [0.1, 1.0, 0.5], [0.2, 1.0, 0.5]]), 0.1)
CHAIR = SurfaceChange("new", np.array([[2.0, 1.0, 0.5]]), 0.05)


def test_what_is_written_is_read(tmp_path):
    voxels = tmp_path / "changes.npz"
    assert read_changes(voxels) == ()
    write_changes(tmp_path / "changes.json", voxels, (TABLE, CHAIR))
    for found, written in zip(read_changes(voxels), (TABLE, CHAIR), strict=True):
        assert (found.kind, found.voxel_m) == (written.kind, written.voxel_m)
        np.testing.assert_allclose(found.xyz_m, written.xyz_m, atol=1e-6)
    write_changes(tmp_path / "changes.json", voxels, ())
    assert read_changes(voxels) == ()


@pytest.mark.parametrize(
    ("spoilt", "says"),
    [
        ({"voxel_m": [0.1, -1.0]}, "voxels are -1 to 0.1 m wide"),
        ({"voxel_m": [np.nan, 0.1]}, "voxel_m is not finite"),
        ({"change": np.array([0, 0, 0, 7])}, "not each of its 2 pieces has voxels"),
        ({"xyz_m": np.zeros(4)}, "xyz_m"),
    ],
)
def test_a_damaged_file_is_one_sentence(tmp_path, spoilt, says):
    voxels = tmp_path / "changes.npz"
    write_changes(tmp_path / "changes.json", voxels, (TABLE, CHAIR))
    with np.load(voxels) as arrays:
        np.savez(voxels, **{**arrays, **spoilt})
    with pytest.raises(RunFolderError, match=says):
        read_changes(voxels)
    voxels.write_bytes(b"no archive")
    with pytest.raises(RunFolderError, match="cannot be read as changes"):
        read_changes(voxels)
