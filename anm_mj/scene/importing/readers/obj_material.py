"""Material files of OBJ meshes: what they name, and their lines as the library that reads them expects them."""

import re
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import NamedTuple

from anm_mj.scene.importing.readers.import_limits import MAX_MESH_MIB
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.texture_file import TRANSFORMED, files_of_words, find_texture
from anm_mj.utils.read_file import read_bytes

_NO_MATERIAL = "Not in the .mtl files: the materials {names}; surfaces that need them come out grey."
_BYTE_ORDER_MARK = re.compile(rb"(?m)^\xef\xbb\xbf")
_NUMBERS = rb"(?:[ \t]+[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?){1,3}"
_OPTION = rb"-(?:[ost]%b|mm[ \t]+\S+[ \t]+\S+|(?:bm|blend[uv]|cc|clamp|imfchan|texres|boost|type)[ \t]+\S+)" % _NUMBERS
_OPTIONS = re.compile(rb"(?im)^([ \t]*map_kd[ \t]+)((?:%b[ \t]+)+)" % _OPTION)
"""What may stand before the name of a picture, and the library takes for the beginning of that name."""
_MOVED = re.compile(rb"(?i)-([ost])(%b)" % _NUMBERS)
_NAMED = r"(?m)^[ \t]*(?:usemtl|mtllib)[ \t]+(.*)$"
_ENTRY = re.compile(r"(?im)^[ \t]*(newmtl|map_kd)[ \t]+(.*)$")


class Materials(NamedTuple):
    """What is known of the materials that an OBJ file uses."""

    pictured: frozenset[bytes] = frozenset()
    """Names of those with a picture, as they stand in the file."""
    latin: bool = False
    """Whether texts that are no UTF-8 are to be taken for Latin-1."""


class _Found(NamedTuple):
    missing: dict[bytes, str]
    """Names of materials that are in no material file, as they stand in the OBJ file, and as they are read."""
    pictured: frozenset[bytes]
    has_files: bool
    has_pictures: bool
    is_moved: bool
    """Whether a picture is shifted or scaled."""


def check_materials(
    src: Path, used: Collection[bytes], libraries: Sequence[bytes], plain: bool, report: ImportReport
) -> Materials:
    """Look for the materials that an OBJ file uses in the files that it names, and note those that are in none.

    ``plain`` says whether the OBJ file itself is UTF-8. Raises OSError or ValueError if a file cannot be read.
    """
    if not libraries:
        return Materials()
    found, latin = _look(src, used, libraries, plain, latin=False), False
    if found.missing or not (found.has_files and found.has_pictures):
        # The library guesses the encoding of either file by itself, so that one name may become two.
        other = _look(src, used, libraries, plain, latin=True)
        latin = _faults(other) < _faults(found)
        found = other if latin else found
    # Where a file is missing, its name is reported as it is asked for.
    for name in sorted(found.missing.values()) if found.has_files else ():
        report.add(_NO_MATERIAL, f"{name} of {src.name}")
    if found.is_moved:
        report.add(TRANSFORMED, src.name)
    return Materials(found.pictured, latin)


def even_materials(content: bytes, latin: bool) -> bytes:
    """A material file without byte order mark and without options of pictures, and with ``latin`` as UTF-8 if it is in
    another encoding.
    """
    content = _BYTE_ORDER_MARK.sub(b"", content)
    if latin and not is_utf8(content):
        content = content.decode("latin-1").encode()
    return _OPTIONS.sub(rb"\1", content)


def _faults(found: _Found) -> tuple[bool, int, bool]:
    return not found.has_files, len(found.missing), not found.has_pictures


def _look(src: Path, used: Collection[bytes], libraries: Sequence[bytes], plain: bool, latin: bool) -> _Found:
    """What of the materials is found if texts that are no UTF-8 are Latin-1, or what the library guesses."""
    from trimesh.util import decode_text

    read, folder = _reading(src, plain, latin), src.absolute().parent
    files = [file for words in libraries for file in files_of_words(read(words), folder)]
    content = b"\n".join(read_bytes(file, MAX_MESH_MIB) for file in files if file is not None)
    names, pictured, has_pictures, name = set[str](), set[str](), True, ""
    for keyword, words in _ENTRY.findall(decode_text(even_materials(content, latin))):
        if keyword.lower() == "newmtl":
            name = " ".join(words.split())
            names.add(name)
        else:
            pictured.add(name)
            has_pictures = has_pictures and find_texture(words, folder) is not None
    as_read = {word: read(word) for word in used}
    return _Found(
        {word: name for word, name in as_read.items() if name not in names},
        frozenset(word for word, name in as_read.items() if name in pictured),
        None not in files,
        has_pictures,
        any(_is_moved(options) for _, options in _OPTIONS.findall(content)),
    )


def _is_moved(options: bytes) -> bool:
    usual = {b"s": 1.0}
    return any(
        float(number) != usual.get(kind.lower(), 0.0)
        for kind, words in _MOVED.findall(options)
        for number in words.split()
    )


def _reading(src: Path, plain: bool, latin: bool) -> Callable[[bytes], str]:
    """How the names in an OBJ file are read."""
    from trimesh.util import decode_text

    if plain or latin:
        return lambda word: word.decode("utf-8" if plain else "latin-1")
    text = read_bytes(src, MAX_MESH_MIB)
    raw, guessed = re.findall(_NAMED.encode(), text), re.findall(_NAMED, decode_text(text))
    as_read = {word.strip(): name.strip() for word, name in zip(raw, guessed, strict=False)}
    return lambda word: as_read.get(word, "")


def is_utf8(text: bytes) -> bool:
    """Whether a text is UTF-8."""
    try:
        text.decode()
    except UnicodeDecodeError:
        return False
    return True
