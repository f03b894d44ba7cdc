import subprocess
from dataclasses import replace

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image, ImageDraw, ImageSequence
from PIL.ImageColor import getrgb

from anm_mj.cli.main import main
from anm_mj.io.read_run import read_run
from anm_mj.replay.film import HEIGHT_PX, WIDTH_PX, _cut, film_frames
from anm_mj.replay.film_depth_and_colour import PANEL_PX, colour_panel, font
from anm_mj.replay.film_file import GIF_WIDTH_PX, write_gif, write_mp4
from anm_mj.replay.film_map_and_surface import MapPanel, SurfacePanel
from anm_mj.replay.surface import growing_mesh
from anm_mj.replay.timeline import Timeline, read_timeline
from anm_mj.types import Pose2
from anm_mj.utils.files import atomic_write
from anm_mj.viz import palette
from tests.box_room import room_plan


def close_to(image, colour, tolerance=30):
    return np.abs(np.asarray(image).astype(int) - getrgb(colour)).max(axis=2) < tolerance


def test_a_film_has_the_frames_of_the_run(run_folder, tmp_path):
    path = tmp_path / "film.mp4"
    assert main(["export", str(run_folder), "--video", str(path), "--every", "8", "--fps", "5"]) == 0
    ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
    words = [ffmpeg, "-loglevel", "info", "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(words, capture_output=True, check=True)
    assert f"{WIDTH_PX}x{HEIGHT_PX}" in done.stderr.decode()
    assert " 5 fps" in done.stderr.decode()
    frames = np.frombuffer(done.stdout, np.uint8).reshape(-1, HEIGHT_PX, WIDTH_PX, 3)
    assert len(frames) == 6  # Steps 0, 8, ..., 40.
    assert np.abs(frames[0].astype(int) - frames[-1]).mean() > 3.0


@pytest.mark.parametrize("fps", [4, 50])
def test_a_gif_is_small_and_shows_every_frame(run_folder, tmp_path, fps):
    path = tmp_path / "film.gif"
    assert main(["export", str(run_folder), "--video", str(path), "--every", "9", "--fps", str(fps)]) == 0
    drawn = [Image.fromarray(frame) for frame in film_frames(read_timeline(run_folder), every=9)]
    with Image.open(path) as film:
        assert film.size[0] == GIF_WIDTH_PX
        shown = list(ImageSequence.all_frames(film, lambda each: each.convert("RGB")))
        duration_ms = film.info["duration"]
    assert path.stat().st_size < 400_000
    assert list(tmp_path.iterdir()) == [path]
    # Steps 0, 9, ..., 36, and the last.
    assert len(shown) == len(drawn) == 6
    assert duration_ms == 1000 / fps
    for index, one in enumerate(shown):
        apart = [np.abs(np.asarray(each.resize(one.size)).astype(int) - np.asarray(one)).mean() for each in drawn]
        assert np.argmin(apart) == index
        assert apart[index] < 3.0


@pytest.mark.parametrize("suffix", ["mp4", "gif"])
@pytest.mark.parametrize("script", ['ulimit -f 4; exec {} "$@"', "exit 1", "exit 0", "echo no such codec >&2; exit 8"])
def test_a_film_that_ffmpeg_fails_to_write_replaces_none(run_folder, tmp_path, monkeypatch, capsys, suffix, script):
    path, ffmpeg = tmp_path / "films" / f"film.{suffix}", tmp_path / "ffmpeg"
    path.parent.mkdir()
    path.write_bytes(b"an earlier film")
    ffmpeg.write_text("#!/bin/sh\n" + script.format(imageio_ffmpeg.get_ffmpeg_exe()) + "\n")
    ffmpeg.chmod(0o755)
    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", lambda: str(ffmpeg))
    assert main(["export", str(run_folder), "--video", str(path), "--every", "8"]) == 2
    (said,) = [" ".join(part.split()) for part in capsys.readouterr().err.split("anm-mj: ")[1:]]
    assert said.startswith(f"{path} cannot be written (")
    assert ("no such codec" if "codec" in script else "ffmpeg ended with status") in said
    assert list(path.parent.iterdir()) == [path]
    assert path.read_bytes() == b"an earlier film"


@pytest.mark.parametrize("write", [write_mp4, write_gif])
def test_a_film_that_is_interrupted_leaves_nothing(tmp_path, write):
    def images():
        yield np.zeros((64, 64, 3), np.uint8)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), atomic_write(tmp_path / "film") as partial:
        write(partial, images(), 64, 64, 5.0)
    assert list(tmp_path.iterdir()) == []


def test_the_surface_grows_in_the_film(run_folder):
    mesh = growing_mesh(read_run(run_folder), with_errors=False)
    assert mesh is not None
    timeline = read_timeline(run_folder)
    panel = SurfacePanel(mesh)
    filled = [(~close_to(panel.draw(timeline, frame), "#f3f4f6", 3)).mean() for frame in (0, 20, 40)]
    assert 0.02 < filled[0] < filled[1] < filled[2]
    # The floor, 4 x 3 m, of a picture about 4.8 m wide, and walls.
    assert filled[2] > 0.35


def test_the_map_has_north_up_and_the_robot_in_its_place(run_folder):
    run = read_run(run_folder)
    moved = replace(run.frames[1], pose=Pose2(1.5, 1.0, 0.0))
    panel = MapPanel(np.array([[-2.1, -2.1], [2.1, 2.1]]), 0.18)
    image = panel.draw(Timeline(replace(run, frames=(run.frames[0], moved))), 1, room_plan().path_xy_m[:2])
    rows, cols = np.nonzero(close_to(image, palette.CAMERA, 10))
    assert np.median(cols) == pytest.approx(PANEL_PX * (1.5 + 2.5) / 5.0, abs=3)
    assert np.median(rows) == pytest.approx(PANEL_PX * (2.5 - 1.0) / 5.0, abs=3)


def test_the_target_stands_in_the_picture_where_it_is(run_folder):
    run = read_run(run_folder)
    rgb = np.full((256, 256, 3), 128, np.uint8)
    frame = run.frames[0]
    plain = colour_panel(rgb, frame, run.intrinsics, None)
    # From (0, 0) along x, a camera at 1.25 m: 1.5 m ahead, half a metre to the left.
    marked = close_to(colour_panel(rgb, frame, run.intrinsics, np.array([1.5, 0.5])), palette.TARGET)
    rows, cols = np.nonzero(marked)
    assert not close_to(plain, palette.TARGET).any()
    assert np.median(cols) == pytest.approx(PANEL_PX * (0.5 - 0.5 * 0.5 / 1.5), abs=4)
    assert rows.min() == pytest.approx(PANEL_PX * (0.5 + 0.5 * (1.25 - 0.4) / 1.5), abs=12)
    # Behind the camera there is nothing to mark.
    assert not close_to(colour_panel(rgb, frame, run.intrinsics, np.array([-1.0, 0.0])), palette.TARGET).any()


def test_a_run_without_mesh_and_images_makes_a_film(run_folder, tmp_path):
    for name in ("steps.jsonl", "frames.jsonl", "camera.json", "depth"):
        (tmp_path / name).symlink_to(run_folder / name)
    frames = list(film_frames(read_timeline(tmp_path), every=40))
    assert [frame.shape for frame in frames] == [(HEIGHT_PX, WIDTH_PX, 3)] * 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--video", "film.avi"], "an .mp4 or a .gif file"),
        (["--video", "nowhere/film.gif"], "nowhere/film.gif cannot be written (No such file or directory); choose"),
        (["--video", "film.mp4", "--fps", "0"], "choose 0.1 to 120"),
        (["--video", "film.gif", "--fps", "60"], "choose 0.1 to 50"),
        (["--video", "film.mp4", "--every", "0"], "from 1 up"),
        ([], "Nothing to export"),
        (["--format", "glb", "--fps", "5"], "--fps is 5.0, but no film is written; add --video film.mp4"),
        (["--format", "glb", "--every", "1"], "--every is 1, but no film is written"),
        (["--format", "glb", "--scene", "home"], "--scene is home, but no film is written"),
        (["--video", "x.gif", "--out", "out"], "--out is out, but no other format is written; add --format NAME"),
        (["--video", "x.gif", "--start", "0"], "--start is 0.0, but no other format is written"),
        (["--video", "x.gif", "--scene", "home"], "--scene is home, but the film shows the images that were kept"),
        (["--format", "glb", "--out", "out", "--start", "0"], "--start is 0.0, but no chosen format has times of day"),
    ],
)
def test_what_cannot_be_is_one_sentence(run_folder, tmp_path, monkeypatch, capsys, options, words):
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(run_folder), *options]) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []


def test_a_reason_of_any_length_is_cut_to_a_line():
    draw = ImageDraw.Draw(Image.new("RGB", (1, 1)))
    assert _cut("short", draw) == "short"
    cut = _cut("W" * 10**6, draw)
    assert cut.endswith("W …")
    assert 0.95 * WIDTH_PX < draw.textlength(cut, font(15)) <= WIDTH_PX
