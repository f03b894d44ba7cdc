"""Colour images out of a video, as phones record it beside the depth."""

import io
import subprocess
import tempfile
import weakref
from pathlib import Path
from typing import IO

import numpy as np
from jaxtyping import UInt8

from anm_mj.errors import RunFolderError
from anm_mj.utils.picture import read_picture
from anm_mj.utils.read_file import open_regular


def video_size(path: Path) -> tuple[int, int]:
    """Width and height of a video's frames as they are stored [px]. Raises RunFolderError if it cannot be decoded."""
    with tempfile.TemporaryFile() as file:
        _decode(path, file, 1, "-c:v", "png", "-f", "image2pipe")
        file.seek(0)
        try:
            with read_picture(io.BytesIO(file.read())) as picture:
                return picture.size
        except (OSError, ValueError) as err:
            raise RunFolderError(f"{path} holds no picture ({err}); copy it again.") from err


class VideoFrames:
    """The frames of a video at a smaller size, decoded when the first is asked for, and kept in a temporary file."""

    def __init__(self, path: Path, width: int, height: int, count: int) -> None:
        """Nothing is decoded yet. Of the video, of the kind of MP4 and MOV, ``count`` frames are decoded at most, to
        ``width`` x ``height`` pixels.
        """
        self._path, self._count = path, count
        self._shape = (height, width, 3)
        self._file: IO[bytes] | None = None

    def read(self, index: int) -> UInt8[np.ndarray, "h w 3"]:
        """A frame by its number. Raises RunFolderError if the video cannot be decoded, or ends before."""
        height, width, _ = self._shape
        if self._file is None:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115 - it is read as long as the object lives
            weakref.finalize(self, self._file.close)
            size = ("-vf", f"scale={width}:{height}:flags=area", "-pix_fmt", "rgb24", "-f", "rawvideo")
            _decode(self._path, self._file, self._count, *size)
        count = height * width * 3
        self._file.seek(index * count)
        pixels = self._file.read(count)
        if len(pixels) < count:
            raise RunFolderError(f"{self._path} ends before frame {index}; copy it again.")
        return np.frombuffer(pixels, np.uint8).reshape(self._shape)


def _decode(path: Path, into: IO[bytes], count: int, *options: str) -> None:
    """Let ffmpeg write frames of a video: of this one file, as it is stored."""
    try:
        import imageio_ffmpeg
    except ImportError as err:
        raise RunFolderError(
            f"{path} is a video: pip install 'anm-mj[video]', or make images of it by ffmpeg -i {path.name} "
            "-start_number 0 rgb/%06d.png."
        ) from err
    try:
        open_regular(path).close()
    except OSError as err:
        raise RunFolderError(f"{path} cannot be read ({err.strerror}); copy it again.") from err
    words = [imageio_ffmpeg.get_ffmpeg_exe(), "-nostdin", "-v", "error", "-protocol_whitelist", "file", "-noautorotate"]
    words += ["-f", "mov", "-i", f"file:{path}", "-an", "-fps_mode", "passthrough", "-frames:v", str(count)]
    done = subprocess.run([*words, *options, "-"], stdout=into, stderr=subprocess.PIPE, check=False)
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise RunFolderError(f"{path} cannot be decoded ({said[-1] if said else 'ffmpeg failed'}); copy it again.")
