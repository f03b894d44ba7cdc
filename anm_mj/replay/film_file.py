"""Writes the pictures of a film to a file: MP4 (H.264) or GIF, by ffmpeg."""

import errno
import os
import subprocess
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from jaxtyping import UInt8

GIF_WIDTH_PX = 640
_PALETTE_PICTURES = 100
"""The colours of a GIF are those of about so many of its pictures."""


def write_mp4(
    path: Path, images: Iterable[UInt8[np.ndarray, "h w 3"]], width_px: int, height_px: int, fps: float
) -> None:
    """Write pictures of an even width and height as they come. Raises OSError if the file cannot be written."""
    options = ("-c:v", "libx264", "-pix_fmt", "yuv420p", "-preset", "veryfast", "-crf", "23", "-f", "mp4")
    _ffmpeg(path, *_raw(width_px, height_px, fps), *options, images=images)


def write_gif(
    path: Path, images: Iterable[UInt8[np.ndarray, "h w 3"]], width_px: int, height_px: int, fps: float
) -> None:
    """Write pictures, each of them, at a width of ``GIF_WIDTH_PX``. Raises OSError if the file cannot be written."""
    # The palette comes before the first picture: until it is known, the pictures wait on the disk, not in memory.
    with tempfile.TemporaryDirectory(prefix=f"{path.name}.", dir=path.parent) as folder:
        small, colours = Path(folder) / "small.nut", Path(folder) / "palette.png"
        options = ("-vf", f"scale={GIF_WIDTH_PX}:-1:flags=lanczos", "-c:v", "ffv1", "-pix_fmt", "bgr0")
        count = _ffmpeg(small, *_raw(width_px, height_px, fps), *options, images=images)
        chain = f"framestep={-(-count // _PALETTE_PICTURES)},palettegen=max_colors=256:stats_mode=full"
        _ffmpeg(colours, "-i", f"file:{small}", "-vf", chain)
        given = (*_rate(fps), "-i", f"file:{small}", "-i", f"file:{colours}")
        _ffmpeg(path, *given, "-lavfi", "paletteuse=dither=none:diff_mode=rectangle", "-f", "gif")


def _rate(fps: float) -> tuple[str, str]:
    return "-r", str(Fraction(fps).limit_denominator())


def _raw(width_px: int, height_px: int, fps: float) -> tuple[str, ...]:
    return "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width_px}x{height_px}", *_rate(fps), "-i", "-"


def _ffmpeg(path: Path, *words: str, images: Iterable[UInt8[np.ndarray, "h w 3"]] = ()) -> int:
    """Let ffmpeg write a file, of pictures that it is sent or of what ``words`` name; returns how many it was sent.
    Raises OSError if it fails.
    """
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-nostdin", "-v", "error", "-y", *words, f"file:{path}"]
    count = 0
    with tempfile.TemporaryFile() as said:
        # Ctrl-C is to reach this program alone, which then ends ffmpeg.
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=said, start_new_session=True
        ) as ffmpeg:
            assert ffmpeg.stdin is not None
            try:
                # What has failed reads no more.
                with suppress(BrokenPipeError), ffmpeg.stdin:
                    for image in images:
                        ffmpeg.stdin.write(image)
                        count += 1
            except BaseException:
                ffmpeg.kill()
                raise
        said.seek(0)
        told = said.read().decode(errors="replace").strip()
    if ffmpeg.returncode or not path.is_file() or not path.stat().st_size:
        full = os.strerror(errno.ENOSPC)
        if full in told:
            raise OSError(errno.ENOSPC, full)
        last = told.rpartition("\n")[2] or f"ffmpeg ended with status {ffmpeg.returncode}"
        raise OSError(errno.EIO, last)
    return count
