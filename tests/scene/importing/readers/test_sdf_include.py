import pytest

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers import import_limits as limits
from anm_mj.scene.importing.readers.import_limits import LimitError
from tests.scene.importing.readers.gazebo_worlds import box, read_parts, write_model, write_world


def test_comments_that_xml_forbids_are_taken_as_gazebo_takes_them(tmp_path):
    note = "<!-- not -- \n yet: the first end --> of a comment --> counts"
    parts, _ = read_parts(write_world(tmp_path / "w.sdf", note + box("a") + "<!-- --" + box("b") + "-->"))
    assert [part.part for part in parts] == ["a/l"]
    with pytest.raises(SceneError, match="line 4"):
        read_parts(write_world(tmp_path / "open.sdf", f"{note}\n\n<model>"))


def test_comments_that_never_end_are_refused_in_one_pass(tmp_path):
    with pytest.raises(SceneError, match="is damaged"):
        read_parts(write_world(tmp_path / "w.sdf", "<!-- --" + "<!--" * 1_000_000))


@pytest.mark.timeout(60)
def test_models_that_include_others_many_times_end_somewhere(tmp_path, monkeypatch):
    for level in range(8):
        inner = f"<include><uri>model://m{level + 1}</uri></include>" * 10 if level < 7 else "<link name='l'/>"
        write_model(tmp_path / "models", f"m{level}", inner)
    src = write_world(tmp_path / "w.sdf", "<include><uri>model://m0</uri></include>" + box("a"))
    monkeypatch.setattr(limits, "MAX_TRIANGLES", 100 * 500)
    with pytest.raises(LimitError, match=r"w.sdf includes more than 100 models.*ANM_MJ_MAX_TRIANGLES"):
        read_parts(src)
    src.write_text(src.read_text().replace("m0", "m6"))
    assert [part.part for part in read_parts(src)[0]][:1] == ["a/l"]
