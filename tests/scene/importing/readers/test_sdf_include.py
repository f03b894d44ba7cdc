import pytest

from anm_mj.errors import SceneError
from tests.scene.importing.readers.gazebo_worlds import box, read_parts, write_world


def test_comments_that_xml_forbids_are_taken_as_gazebo_takes_them(tmp_path):
    note = "<!-- not -- \n yet: the first end --> of a comment --> counts"
    parts, _ = read_parts(write_world(tmp_path / "w.sdf", note + box("a") + "<!-- --" + box("b") + "-->"))
    assert [part.part for part in parts] == ["a/l"]
    with pytest.raises(SceneError, match="line 4"):
        read_parts(write_world(tmp_path / "open.sdf", f"{note}\n\n<model>"))


def test_comments_that_never_end_are_refused_in_one_pass(tmp_path):
    with pytest.raises(SceneError, match="is damaged"):
        read_parts(write_world(tmp_path / "w.sdf", "<!-- --" + "<!--" * 1_000_000))
