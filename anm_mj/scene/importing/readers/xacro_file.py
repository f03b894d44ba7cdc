"""Expands worlds and robots that are written with macros (xacro), where the program that does so is installed."""

import importlib
from pathlib import Path

from anm_mj.errors import SceneError

XACRO = ".xacro"


def expanded(src: Path) -> bytes:
    """What the macros of a file make of it, with the defaults of its arguments. Raises SceneError if xacro is not
    installed, or refuses the file.
    """
    try:
        xacro = importlib.import_module("xacro")
    except ImportError:
        raise SceneError(
            f"{src} is written with macros: install xacro (pip install xacro), or expand it with "
            f"`xacro {src.name} > {src.name.removesuffix(XACRO)}` and give that."
        ) from None
    try:
        return xacro.process_file(str(src)).toxml().encode()
    # xacro evaluates Python expressions, which raise anything.
    except Exception as err:
        line = str(err).strip().split("\n")[0] or type(err).__name__
        raise SceneError(f"{src} cannot be expanded ({line}): fix it, or expand it with `xacro` yourself.") from err
