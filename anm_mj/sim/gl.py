"""Chooses the GL back-end that pictures are made with, before mujoco is imported for the first time.

mujoco reads MUJOCO_GL when it is imported and cannot change its mind afterwards, and a back-end whose library is
missing makes that import fail with an AttributeError. So each candidate is tried in a process of its own, and this
module must not import mujoco.
"""

from __future__ import annotations

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

_logger = logging.getLogger(__name__)

_CANDIDATES = {"Linux": ("egl", "osmesa"), "Darwin": ("cgl",), "Windows": ("wgl",)}
_OFF = ("disable", "disabled", "off", "false", "0")
"""Values of MUJOCO_GL with which mujoco simulates but makes no pictures."""
_PROBE_TIMEOUT_S = 60.0
_ADVICE = (
    "Install one: `apt install libegl1 libgl1-mesa-dri` (for egl) or `apt install libosmesa6` (for osmesa), "
    "neither of which needs a screen or a GPU."
)


@dataclass(frozen=True)
class GlBackend:
    """The back-end that pictures are made with."""

    name: str
    """The value of MUJOCO_GL; "off" when none works, or the user wants none."""
    renderer_string: str
    """What GL calls itself (GL_RENDERER): tells a GPU from the software renderer llvmpipe; empty when off."""
    attempts: tuple[tuple[str, str], ...]
    """Each back-end that was tried and does not work here, with the last line of its error."""


@functools.cache
def select_backend() -> GlBackend:
    """The GL back-end of this process; sets MUJOCO_GL accordingly.

    Call it before the first ``import mujoco``. A MUJOCO_GL set by the user is respected: that back-end is tried alone.
    Otherwise egl is tried first (a GPU, if there is one), then osmesa. A back-end that worked is remembered in the
    user's cache folder for this machine and this version of mujoco, so that only the first call ever takes seconds.

    If none works, MUJOCO_GL becomes "off": the world can still be simulated, and pictures be made by casting rays. One
    warning says which back-ends failed, why, and how to get one.

    Raises:
        RenderError: if the back-end that the user has set does not work, or mujoco was imported before with one that
            does not.
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
    _logger.warning("No GL back-end works here (%s), so pictures are made by casting rays. %s", tried, _ADVICE)
    os.environ["MUJOCO_GL"] = "off"
    return GlBackend("off", "", tuple(attempts))


def require_unforked() -> None:
    """Note that this process is about to make a GL context, or refuse to if a process that it was forked from has.

    GL's threads and connections are not there in a forked process: the first picture would never be done.

    Raises:
        RenderError: if this process was forked from one that called this.
    """
    global _gl_process
    if _gl_process is None:
        _gl_process = os.getpid()
    if _gl_process != os.getpid():
        raise RenderError(
            f"This process was forked from one that has made pictures ({_gl_process}), which GL does not survive: "
            'start it by the method "spawn" or "forkserver" instead, as multiprocessing.get_context does and, '
            'for Gymnasium, make_vec(..., vector_kwargs={"context": "spawn"}).'
        )


_gl_process: int | None = None
"""The process that has, or had, GL contexts; a fork inherits it."""


class ProbeError(Exception):
    """A back-end does not work; the message is the last line of its error."""


def _imported_backend() -> str | None:
    """The back-end that an already imported mujoco is bound to, or None while it is not imported."""
    if "mujoco" not in sys.modules:
        return None
    bound = [name for name in ("egl", "osmesa", "cgl", "glfw") if f"mujoco.{name}" in sys.modules]
    return bound[0] if bound else "glfw"


def _probe_cached(name: str) -> str:
    """The GL_RENDERER string of a back-end that works, from the cache if it has worked before.

    Only successes are remembered: after a failure the user will install something and try again.
    """
    path = _cache_path(name)
    try:
        return str(json.loads(path.read_text())["renderer"])
    except (OSError, ValueError, KeyError):
        pass
    renderer_string = probe(name)
    store_in_cache(path, json.dumps({"backend": name, "renderer": renderer_string}).encode())
    return renderer_string


def forget_backend(name: str) -> None:
    """Drop what the cache says about a back-end, because it has stopped working."""
    _cache_path(name).unlink(missing_ok=True)


def _cache_path(name: str) -> Path:
    """Where the probe's result for this machine, this mujoco and this device is kept."""
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
    """The GL_RENDERER string of a back-end that has just rendered a red box, in a process of its own.

    Raises:
        ProbeError: if that fails in whatever way.
    """
    program = Path(__file__).with_name("gl_probe.py")
    try:
        # -P keeps the program's folder off sys.path, where its neighbours would shadow other packages' modules.
        done = subprocess.run(
            [sys.executable, "-P", str(program)],
            env={**os.environ, "MUJOCO_GL": name},
            capture_output=True,
            text=True,
            timeout=_PROBE_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired as err:
        raise ProbeError(f"no picture after {_PROBE_TIMEOUT_S:.0f} s") from err
    if done.returncode != 0:
        lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
        # The first exception is the cause; later ones are its consequences, or GL's own when the process ends.
        errors = [line for line in lines if line.split(":")[0].endswith("Error")]
        raise ProbeError(next(iter(errors + lines[-1:]), f"the process ended with status {done.returncode}"))
    return done.stdout.strip()
