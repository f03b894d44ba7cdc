"""A bag takes the place of an exported one only."""

import shutil

import pytest

from anm_mj.errors import RunFolderError
from anm_mj.export.rosbag import export_rosbag
from anm_mj.io.read_run import read_run


def test_a_folder_that_no_export_wrote_is_not_replaced(run_folder, tmp_path):
    run, folder = read_run(run_folder), tmp_path / "rosbag"
    for name in ("rosbag_0.mcap", "notes.txt"):
        folder.mkdir()
        (folder / "metadata.yaml").touch()
        (folder / name).write_text("mine")
        with pytest.raises(RunFolderError, match=f"holds {name}, which no export writes"):
            export_rosbag(run, tmp_path)
        assert (folder / name).read_text() == "mine"
        shutil.rmtree(folder)
    folder.symlink_to(tmp_path)
    with pytest.raises(RunFolderError, match="no folder of an export"):
        export_rosbag(run, tmp_path)
    folder.unlink()
    export_rosbag(run, tmp_path)
    export_rosbag(run, tmp_path)
    assert {path.name for path in folder.iterdir()} == {"metadata.yaml", "rosbag.mcap"}
    assert [path.name for path in tmp_path.iterdir()] == ["rosbag"]
