"""Selects the GL back-end before the first import of mujoco.

mujoco reads MUJOCO_GL at its import and ignores later changes; if the back-end's library is missing, the import fails
with an AttributeError. Therefore each candidate is tested in a process of its own, and this module must not import
mujoco.
"""

import functools
import hashlib
import importlib.metadata
import json
import logging
import os
import platform
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from anm_mj.errors import RenderError
from anm_mj.utils.files import cache_folder, store_in_cache
from anm_mj.utils.read_file import read_json

_logger = logging.getLogger(__name__)

_CANDIDATES = {"Linux": ("egl", "osmesa"), "Darwin": ("cgl",), "Windows": ("wgl",)}
_OFF = ("disable", "disabled", "off", "false", "0")
"""Values of MUJOCO_GL that disable rendering in mujoco."""
_PROBE_TIMEOUT_S = 60.0
_ADVICE = (
    "Install one: `apt install libegl1 libgl1-mesa-dri` (for egl) or `apt install libosmesa6` (for osmesa), "
    "neither of which needs a screen or a GPU."
)


@dataclass(frozen=True)
class GlBackend:
    """The selected back-end."""

    name: str
    """The value of MUJOCO_GL; "off" if none works or the user disables GL."""
    renderer_string: str
    """GL_RENDERER, which distinguishes a GPU from a software renderer such as llvmpipe; empty when off."""
    attempts: tuple[tuple[str, str], ...]
    """Name and error of each candidate that failed."""


@functools.cache
def select_backend() -> GlBackend:
    """The GL back-end of this process; sets MUJOCO_GL accordingly.

    Call it before the first ``import mujoco``. If the user sets MUJOCO_GL, only that back-end is tested; otherwise egl
    (a GPU, if there is one), then osmesa. The user's cache folder keeps a success per machine and version of mujoco, so
    only the first call takes seconds.

    If none works, MUJOCO_GL becomes "off": simulation still works, and ray casting renders the images. One warning
    names the failed back-ends, their errors and the remedy. Raises RenderError if the user's back-end does not work, or
    mujoco was imported earlier with one that does not.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    if wanted in _OFF:
        return GlBackend("off", "", ())
    imported = _imported_backend()
    if imported is not None:
        candidates = (imported,)
    else:
        candidates = (wanted,) if wanted else _CANDIDATES.get(platform.system(), ("glfw",))

    attempts: list[tuple[str, str]] = []
    for name in candidates:
        try:
            renderer_string = _probe_cached(name)
        except ProbeError as err:
            attempts.append((name, str(err)))
            continue
        os.environ["MUJOCO_GL"] = name
        _logger.debug("GL back-end %s: %s", name, renderer_string)
        return GlBackend(name, renderer_string, tuple(attempts))

    tried = "; ".join(f"{name}: {error}" for name, error in attempts)
    if imported is not None:
        raise RenderError(
            f"mujoco was imported before a GL back-end was chosen and is bound to one that does not work here "
            f"({tried}). Call anm_mj.sim.gl.select_backend() before the first `import mujoco`, or set MUJOCO_GL=egl "
            "or MUJOCO_GL=osmesa before starting Python."
        )
    if wanted:
        raise RenderError(
            f"MUJOCO_GL={wanted} is set, but it does not work here ({tried}). {_ADVICE} Or unset MUJOCO_GL to let the "
            "program choose."
        )
    _logger.warning("No GL back-end works here (%s), so ray casting renders the images. %s", tried, _ADVICE)
    os.environ["MUJOCO_GL"] = "off"
    return GlBackend("off", "", tuple(attempts))


def require_unforked() -> None:
    """Register this process as a user of GL, unless it was forked from one.

    A forked process lacks GL's threads and connections, so its first image would never finish. Raises RenderError if
    the parent of this forked process has called this function.
    """
    global _gl_process
    if _gl_process is None:
        _gl_process = os.getpid()
    if _gl_process != os.getpid():
        raise RenderError(
            f"This process was forked from a process that renders with GL ({_gl_process}), which GL does not survive: "
            'start it by the method "spawn" or "forkserver" instead, as multiprocessing.get_context does and, '
            'for Gymnasium, make_vec(..., vector_kwargs={"context": "spawn"}).'
        )


_gl_process: int | None = None
"""Id of the process that uses GL; forks inherit the value."""


class ProbeError(Exception):
    """A back-end does not work; the message is the last line of its error."""


def _imported_backend() -> str | None:
    if "mujoco" not in sys.modules:
        return None
    bound = [name for name in ("egl", "osmesa", "cgl", "glfw") if f"mujoco.{name}" in sys.modules]
    return bound[0] if bound else "glfw"


def _probe_cached(name: str) -> str:
    """The GL_RENDERER string of a working back-end, from the cache after its first success. Failures are not cached:
    the user will install something and try again.
    """
    path = _cache_path(name)
    try:
        return str(read_json(path)["renderer"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    renderer_string = probe(name)
    store_in_cache(path, json.dumps({"backend": name, "renderer": renderer_string}).encode())
    return renderer_string


def forget_backend(name: str) -> None:
    """Remove a back-end from the cache after it has stopped working."""
    _cache_path(name).unlink(missing_ok=True)


def _cache_path(name: str) -> Path:
    key = (
        platform.node(),
        platform.release(),
        sys.executable,
        importlib.metadata.version("mujoco"),
        os.environ.get("MUJOCO_EGL_DEVICE_ID", ""),
        os.environ.get("PYOPENGL_PLATFORM", ""),
        os.environ.get("DISPLAY", ""),
    )
    return cache_folder() / f"gl-{name}-{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.json"


def probe(name: str) -> str:
    """The GL_RENDERER string of a back-end, after rendering a red box in a process of its own. Raises ProbeError if
    that fails.
    """
    program = Path(__file__).with_name("gl_probe.py")
    try:
        # -P keeps the program's folder off sys.path, so that its modules do not shadow other packages.
        done = subprocess.run(
            [sys.executable, "-P", str(program)],
            env={**os.environ, "MUJOCO_GL": name},
            capture_output=True,
            text=True,
            timeout=_PROBE_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired as err:
        raise ProbeError(f"no image after {_PROBE_TIMEOUT_S:.0f} s") from err
    if done.returncode != 0:
        lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
        # The first exception is the cause; later ones are consequences, or come from GL at exit.
        errors = [line for line in lines if line.split(":")[0].endswith("Error")]
        said = next(iter(errors + lines[-1:]), f"the process ended with status {done.returncode}")
        # So PyOpenGL says it.
        raise ProbeError("its library is not installed" if "'NoneType' object has no attribute" in said else said)
    return done.stdout.strip()
