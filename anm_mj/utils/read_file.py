"""Reads files that anybody may have made: never waits for one, never takes more memory than it says.

Every function raises ``OSError`` or ``ValueError`` alone, so that a reader turns both into its own sentence.
"""

import errno
import json
import os
import stat
import tokenize
import tomllib
import zipfile
import zlib
from collections.abc import Callable
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np

MAX_TEXT_MIB = 512
"""Larger text files are refused: the log of a very long run has some hundred megabytes [MiB]."""
MAX_ARRAY_MIB = 1024
"""Larger arrays are refused [MiB]."""


def open_regular(path: Path) -> BufferedReader:
    """Open a regular file to read; a FIFO, a device or a folder is refused without waiting for it. Raises OSError if
    the file cannot be opened, or is no regular file.
    """
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    return os.fdopen(descriptor, "rb")


def is_below(path: Path, folder: Path) -> bool:
    """Whether a file lies below a folder, links followed; one that leads round in a circle does not."""
    # Path.resolve raises an error for such a link.
    try:
        return Path(os.path.realpath(folder)) in Path(os.path.realpath(path)).parents
    # No path has a NUL character in it, and some characters have no bytes.
    except ValueError:
        return False


def read_bytes(path: Path, max_mib: float = MAX_TEXT_MIB) -> bytes:
    """Content of a regular file. Raises OSError if the file cannot be read, or is no regular file, and ValueError if it
    is larger than ``max_mib`` [MiB].
    """
    with open_regular(path) as file:
        size_mib = os.fstat(file.fileno()).st_size / 2**20
        if size_mib > max_mib:
            raise ValueError(f"its {size_mib:.0f} MiB are more than the {max_mib:g} MiB that are read")
        return file.read()


def read_text(path: Path) -> str:
    """Content of a regular text file. Raises OSError or ValueError as :func:`read_bytes`, or if it is not UTF-8."""
    return read_bytes(path).decode("utf-8")


def parse_json(content: bytes | str, parse_constant: Callable[[str], Any] | None = None) -> Any:
    """The value that JSON holds. ``parse_constant`` gives the value of NaN, Infinity and -Infinity, which JSON does not
    know, or raises a ``ValueError``; None = they are taken as numbers. Raises ValueError if it is no JSON, or nested
    too deeply.
    """
    try:
        return json.loads(content, parse_constant=parse_constant)
    except RecursionError:
        raise ValueError("its values are nested too deeply") from None


def read_json(path: Path) -> Any:
    """The value in a JSON file. Raises OSError or ValueError as :func:`read_bytes` and :func:`parse_json`."""
    return parse_json(read_bytes(path))


def read_toml(path: Path) -> dict[str, Any]:
    """The table in a TOML file. Raises OSError or ValueError as :func:`read_bytes`, or if it is no TOML."""
    try:
        return tomllib.loads(read_text(path))
    except RecursionError:
        raise ValueError("its values are nested too deeply") from None


def convert(value: Any, type_: Any) -> Any:
    """A value of JSON or TOML as a type of msgspec, such as a ``Struct`` or a list of them.

    Keys that the type lacks are ignored. Raises ValueError if the value has another shape; the message names the place.
    """
    # Imported here: most commands read nothing that it checks.
    import msgspec

    try:
        return msgspec.convert(value, type_)
    except msgspec.ValidationError as err:
        what, _, where = str(err).replace("`", "").partition(" - at $")
        raise ValueError(f"{where.strip('.')}: {what[0].lower()}{what[1:]}" if where else what) from None


def read_npz(path: Path, max_mib: float = MAX_ARRAY_MIB) -> dict[str, np.ndarray]:
    """The arrays of an ``.npz`` file; their sizes are checked before anything is unpacked, and objects are refused.
    Raises OSError if the file cannot be read, and ValueError if it is no such file, damaged, or its arrays are larger
    than ``max_mib`` together [MiB].
    """
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            members = [info for info in archive.infolist() if info.filename.endswith(".npy")]
            size_mib = sum(max(info.file_size, _stated_bytes(archive, info)) for info in members) / 2**20
            if size_mib > max_mib:
                raise ValueError(f"its arrays of {size_mib:.0f} MiB are more than the {max_mib:g} MiB that are read")
            arrays = {}
            for info in members:
                with archive.open(info) as member:
                    array: Any = np.lib.format.read_array(member, allow_pickle=False)
                arrays[info.filename.removesuffix(".npy")] = array
            return arrays
    # zipfile raises NotImplementedError for an unknown compression, and RuntimeError for an encrypted archive.
    except (EOFError, NotImplementedError, RuntimeError, zipfile.BadZipFile, zlib.error) as err:
        raise ValueError(str(err) or type(err).__name__) from err


def read_npy(path: Path, max_mib: float = MAX_ARRAY_MIB) -> np.ndarray:
    """The array of an ``.npy`` file; its size is checked before memory is taken, and objects are refused. Raises
    OSError if the file cannot be read, and ValueError if it is no such file, damaged, or larger than ``max_mib`` [MiB].
    """
    with open_regular(path) as file:
        size_mib = _array_bytes(file) / 2**20
        if size_mib > max_mib:
            raise ValueError(f"its array of {size_mib:.0f} MiB is more than the {max_mib:g} MiB that are read")
        file.seek(0)
        try:
            array: Any = np.lib.format.read_array(file, allow_pickle=False)
        except EOFError as err:
            raise ValueError("it is cut off") from err
        return array


def read_tensors(path: Path) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """Metadata and arrays of a safetensors file. Raises OSError if the file cannot be read, or is no regular file, and
    ValueError if it is no such file, or damaged.
    """
    from safetensors import SafetensorError, safe_open

    # The library would wait for a FIFO.
    open_regular(path).close()
    try:
        with safe_open(path, framework="np") as file:
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  It is no mapping.
            return file.metadata() or {}, arrays
    # It raises TypeError and AttributeError for types that numpy does not have.
    except (SafetensorError, TypeError, AttributeError) as err:
        raise ValueError(str(err)) from err


def array_of(arrays: dict[str, np.ndarray], name: str, kinds: str, shape: tuple[int | None, ...]) -> np.ndarray:
    """An array of a file, if it is what it should be. ``kinds`` are those of its numbers, such as ``"f"`` or ``"iu"``,
    which must be finite; an axis of ``shape`` that is None may have any length. Raises ValueError if it is missing, or
    something else.
    """
    array = arrays.get(name)
    if array is None:
        raise ValueError(f"it lacks {name}")
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if not fits or array.dtype.kind not in kinds:
        raise ValueError(f"{name} is of type {array.dtype} and shape {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} is not finite")
    return array


def _stated_bytes(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> int:
    with archive.open(info) as member:
        return _array_bytes(member)


def _array_bytes(file: Any) -> int:
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    try:
        shape, _, dtype = read(file)
    # NumPy reads a header that is no text of Python once more as one of Python 2.
    except (tokenize.TokenError, SyntaxError) as err:
        raise ValueError(f"its header is damaged ({err})") from err
    return int(np.prod(shape, dtype=object)) * dtype.itemsize
