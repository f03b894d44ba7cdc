import json

import numpy as np
import pytest

from anm_mj.errors import RunFolderError
from anm_mj.io.curve_file import read_curve
from anm_mj.io.mesh_file import read_coloured_mesh
from anm_mj.io.read_run import read_run, run_title
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.sequence_layouts import open_sequence
from tests.box_room import new_recorder, record_steps

HEADER = "step,completion_ratio,completion_cm,observable_ratio,path_m\n"


@pytest.fixture
def run_folder(tmp_path):
    with new_recorder(tmp_path / "run") as recorder:
        record_steps(recorder, 2)
    return tmp_path / "run"


def change(path, key, value):
    lines = [{**json.loads(line), key: value} for line in path.read_text().splitlines()]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("T_world_camera", np.zeros((4, 4)).tolist(), "no pose of a camera"),
        ("T_world_camera", [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [5, 5, 5, 0]], "no pose of a camera"),
        ("time_s", -5.0, "a time of -5 s"),
        ("time_s", 1e12, "a time of 1e\\+12 s"),
    ],
)
def test_a_frame_that_cannot_be_is_one_sentence(run_folder, key, value, said):
    change(run_folder / "frames.jsonl", key, value)
    with pytest.raises(RunFolderError, match=said):
        read_run(run_folder)


@pytest.mark.parametrize(
    ("part", "key", "value", "said"),
    [
        ("intrinsics", "fx", 1e-300, "camera.json has fx"),
        ("intrinsics", "width", 16384, "camera.json has fx"),
        ("intrinsics", "height", 1, "camera.json has depth"),
        ("depth", "rows", 5, "camera.json has depth of 5 rows"),
    ],
)
def test_a_camera_that_contradicts_itself_is_one_sentence(run_folder, part, key, value, said):
    camera = json.loads((run_folder / "camera.json").read_text())
    camera[part][key] = value
    (run_folder / "camera.json").write_text(json.dumps(camera))
    with pytest.raises(RunFolderError, match=said):
        read_run(run_folder)


@pytest.mark.parametrize("name", ["frames.jsonl", "steps.jsonl"])
def test_lines_that_come_twice_are_one_sentence(run_folder, name):
    path = run_folder / name
    path.write_text(path.read_text() * 2)
    with pytest.raises(RunFolderError, match=rf"step \d in {name} stands after step \d"):
        read_run(run_folder)


def test_a_title_has_no_character_that_commands_the_terminal(run_folder):
    (run_folder / "manifest.json").write_text('{"scene": "a/\\u001b[2Jroom", "policy": "\\u202ex"}')
    assert run_title(RunFolder.open(run_folder)) == " [2Jroom,  x"


def test_a_reason_stays_on_its_line(run_folder):
    (run_folder / "plans.jsonl").write_text(json.dumps({"step": 0, "reason": "a\n\u202eb\x00"}) + "\n")
    assert read_run(run_folder).plans[0]["reason"] == "a  b "


@pytest.mark.parametrize(
    "content",
    [
        "a,b\n1,2\n",
        HEADER + "0.5,1,1,1,1\n",
        HEADER + "1,a,b,c,d\n",
        HEADER + "9,1,1,1,1\n1,1,1,1,1\n",
        HEADER + "0,500,1,1,1\n",
        HEADER + "0,-1,1,1,1\n",
        HEADER + "0,9,1,9,1\n9,5,1,9,1\n",
        HEADER + "0,9,1,9,-1\n",
    ],
)
def test_what_is_no_curve_is_one_sentence(tmp_path, content):
    (tmp_path / "curve.csv").write_text(content)
    with pytest.raises(RunFolderError, match="cannot be read as a curve"):
        read_curve(tmp_path / "curve.csv")


def test_the_last_row_of_a_curve_may_be_cut_off(tmp_path):
    (tmp_path / "curve.csv").write_text(HEADER + "0,1.5,2,,0\n10,3,")
    curve = read_curve(tmp_path / "curve.csv")
    assert curve["step"].tolist() == [0.0]
    assert curve["completion_ratio"].tolist() == [1.5]
    assert np.isnan(curve["observable_ratio"]).all()


@pytest.mark.parametrize(("x", "face"), [("0", "3 0 1 9"), ("1e9", "3 0 1 2")])
def test_a_mesh_that_cannot_be_is_one_sentence(tmp_path, x, face):
    (tmp_path / "mesh.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face 1\nproperty list uchar int vertex_indices\nend_header\n{x} 0 0\n1 0 0\n0 1 0\n{face}\n"
    )
    with pytest.raises(RunFolderError, match="cannot be read as a mesh"):
        read_coloured_mesh(tmp_path / "mesh.ply")


@pytest.mark.parametrize(
    ("kind", "stated"),
    [
        ("float", "1 0.5 0"),
        ("float", "255 128 0"),
        ("uchar", "255 128 0"),
        ("int", "255 128 0"),
        ("ushort", "255 128 0"),
        ("ushort", "65535 32767 90"),
    ],
)
def test_a_mesh_of_quads_and_of_colours_of_any_type_is_read(tmp_path, kind, stated):
    (tmp_path / "mesh.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        f"property {kind} red\nproperty {kind} green\nproperty {kind} blue\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        f"0 0 0 {stated}\n1 0 0 {stated}\n1 1 0 {stated}\n0 1 0 {stated}\n4 0 1 2 3\n"
    )
    vertices, faces, rgb = read_coloured_mesh(tmp_path / "mesh.ply")
    assert (len(vertices), len(faces)) == (4, 2)
    assert rgb[0].tolist() == pytest.approx([255, 128, 0], abs=1)


def edit(path, change):
    """Let a function change the lines of a log."""
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    path.write_text("".join(json.dumps(line) + "\n" for line in change(lines)))


def put_away(frame):
    """The robot of a line and its camera stand a kilometre off."""
    frame["x_m"] += 1000.0
    frame["T_world_camera"][0][3] += 1000.0
    return frame


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("frames.jsonl", lambda lines: [*lines[:1], put_away(lines[1]), *lines[2:]], "step 1 is 1000 m from step 0"),
        ("frames.jsonl", lambda lines: [*lines[:1], {**lines[1], "y_m": 500.0}, *lines[2:]], "the camera of step 1 is"),
        ("steps.jsonl", lambda lines: [*lines, *({**lines[-1], "step": 3 + k} for k in range(3))], "at step 5"),
        ("steps.jsonl", lambda lines: lines[:-1], None),
    ],
)
def test_logs_that_contradict_each_other_are_said(run_folder, caplog, name, change, said):
    edit(run_folder / name, change)
    read_run(run_folder)
    read_run(run_folder)
    assert [said in record.message for record in caplog.records] == ([] if said is None else [True])


def test_a_robot_that_was_lost_may_be_found_anywhere(run_folder, caplog):
    lost = {"state": "LOST", "usable": False, "relocalised": False, "closes_loop": False}

    def lose(lines):
        true = {name: lines[1][name] for name in ("x_m", "y_m", "yaw_rad", "T_world_camera")}
        found = [{**put_away(json.loads(json.dumps(line))), "true": true} for line in lines[1:]]
        return [{**lines[0], "localisation": lost}, *found]

    edit(run_folder / "frames.jsonl", lose)
    read_run(run_folder)
    assert not caplog.records


def test_a_run_that_is_mapped_again_has_the_times_of_its_images(run_folder):
    edit(run_folder / "frames.jsonl", lambda lines: [lines[0], *({**line, "image_age_s": 0.1} for line in lines[1:])])
    sequence, _ = open_sequence(run_folder)
    taken_s = [frame.time_s for frame in sequence.frames]
    told_s = [frame.time_s for frame in read_run(run_folder).frames]
    assert taken_s == [told_s[0], *(pytest.approx(time_s - 0.1) for time_s in told_s[1:])]


def test_a_frame_is_missing(run_folder):
    edit(run_folder / "frames.jsonl", lambda lines: [lines[0], lines[2]])
    with pytest.raises(RunFolderError, match=r"step 2 in frames\.jsonl stands after step 0"):
        read_run(run_folder)
