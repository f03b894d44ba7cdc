"""Checks whether a run is possible on this machine, and what it will use.

Checks that may crash (GL drivers, torch without its libraries) run in processes of their own.
"""

import json
import os
import platform
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from enum import Enum
from importlib import metadata
from pathlib import Path

from anm_mj.errors import RenderError
from anm_mj.io.manifest import cpu_model
from anm_mj.sim.gl import ProbeError, forget_backend, probe, select_backend
from anm_mj.utils.raycast import embree_installed

MIN_MEMORY_MIB = 3072
"""A run of the default preset in a house needs less."""
MIN_DISK_MIB = 1024
"""A run folder of a thousand steps with its depth frames is smaller."""
_TIMEOUT_S = 120.0

TORCH_PROGRAM = """
import json, torch
cuda = torch.cuda.is_available()
gpu = torch.cuda.get_device_properties(0) if cuda else None
memory_gib = round(gpu.total_memory / 2**30) if cuda else 0
print(json.dumps([torch.__version__, torch.get_num_threads(), gpu.name if cuda else "", memory_gib]))
"""

ENGINE_PROGRAM = """
from anm_mj._native import kernel_names
print(kernel_names()[0])
"""


class State(Enum):
    """Result of a check."""

    GOOD = "ok"
    NOTE = "note"
    """A run is possible, but something is missing or slower than necessary."""
    BAD = "wrong"
    """A run is impossible."""


@dataclass(frozen=True)
class Check:
    """One check with its finding."""

    name: str
    state: State
    found: str
    advice: str = ""
    """How to fix or improve it."""


def diagnose() -> list[Check]:
    """Run all checks; takes some seconds."""
    with ThreadPoolExecutor() as pool:
        torch = pool.submit(check_torch)
        devices = pool.submit(egl_devices)
        engine = pool.submit(check_engine)
        backends = [pool.submit(check_backend, name) for name in ("egl", "osmesa")]
        return [
            check_python(),
            check_mujoco(),
            *torch.result(),
            engine.result(),
            *_graphics([backend.result() for backend in backends]),
            *check_egl_devices(*devices.result(), os.environ.get("CUDA_VISIBLE_DEVICES")),
            check_ffmpeg(),
            check_port(),
            check_memory(available_memory_mib()),
            check_disk(Path.cwd()),
        ]


def check_python() -> Check:
    """The interpreter's version and the machine."""
    found = f"{platform.python_version()}, {platform.system()} on {cpu_model()}, {os.cpu_count()} cores"
    return Check("Python", State.GOOD, found)


def check_mujoco() -> Check:
    """The simulator's version."""
    try:
        return Check("mujoco", State.GOOD, metadata.version("mujoco"))
    except metadata.PackageNotFoundError:
        return Check("mujoco", State.BAD, "not installed", "Run make setup, or pip install mujoco.")


def check_torch() -> list[Check]:
    """Torch and its GPU."""
    done = run_python(TORCH_PROGRAM)
    if done.returncode != 0:
        advice = "Only the engines torch and mlp need it: pip install 'anm-mj[torch]'."
        return [Check("torch", State.NOTE, _last_line(done.stderr), advice)]
    version, num_threads, gpu, memory_gib = json.loads(done.stdout)
    torch = Check("torch", State.GOOD, f"{version}, {num_threads} threads")
    if gpu:
        advice = "The map is trained on the CPU; --device cuda trains it on the GPU, by torch."
        return [torch, Check("CUDA", State.GOOD, f"{gpu}, {memory_gib} GiB", advice)]
    return [torch, Check("CUDA", State.GOOD, "no GPU that torch can use; none is needed")]


def check_engine() -> Check:
    """The native engine, which trains the map, and its instruction set."""
    done = run_python(ENGINE_PROGRAM)
    if done.returncode != 0:
        advice = "Install a C++17 compiler (apt install g++) and run make setup."
        return Check("map engine", State.BAD, f"does not start: {_last_line(done.stderr)}", advice)
    return Check("map engine", State.GOOD, f"native ({done.stdout.strip()}) on the CPU")


def check_backend(name: str) -> Check:
    """One GL back-end, tested by rendering an image."""
    try:
        return Check(f"GL {name}", State.GOOD, probe(name))
    except ProbeError as err:
        # The cache may still contain an earlier success.
        forget_backend(name)
        return Check(f"GL {name}", State.NOTE, f"does not work: {err}")


def _graphics(backends: list[Check]) -> list[Check]:
    """The back-ends, and the camera of a run."""
    try:
        chosen = select_backend()
    except RenderError as err:
        return [*backends, Check("pictures by", State.BAD, "nothing", str(err))]
    if chosen.name == "off":
        advice = "Install what is missing above." if chosen.attempts else "MUJOCO_GL turns GL off: unset it."
        if embree_installed():
            return [*backends, Check("pictures by", State.NOTE, "Embree's rays, without GL", advice)]
        found = "MuJoCo's rays, tenths of a second each, one colour per mesh"
        return [*backends, Check("pictures by", State.NOTE, found, f"{advice} Or pip install embreex.")]
    # llvmpipe and softpipe are Mesa's renderers for machines without a GPU.
    software = "pipe" in chosen.renderer_string
    kind = "software, fast enough for 256 x 256 pixels" if software else "hardware"
    return [*backends, Check("pictures by", State.GOOD, f"{chosen.name} ({kind})")]


def egl_devices() -> tuple[list[int | None], int | None]:
    """The CUDA device that each EGL device is, None for others, and the number of the one that draws."""
    done = run_python("from anm_mj.sim.egl_devices import main; main()")
    devices, drawing = json.loads(done.stdout) if done.returncode == 0 else ([], None)
    return devices, drawing


def check_egl_devices(devices: list[int | None], drawing: int | None, visible: str | None) -> list[Check]:
    """Which EGL device draws, and whether it is the GPU that CUDA_VISIBLE_DEVICES leaves to this process."""
    # The choice of a back-end has set it.
    if drawing is None or os.environ.get("MUJOCO_GL") != "egl":
        return []
    names = [f"{k} ({'no CUDA' if cuda is None else f'CUDA {cuda}'})" for k, cuda in enumerate(devices)]
    found = f"{names[drawing]} draws, " + (f"of {', '.join(names)}" if len(names) > 1 else "the only one")
    own = (visible or "").partition(",")[0].strip()
    if not own.isdecimal() or devices[drawing] == int(own) or int(own) not in devices:
        advice = "MUJOCO_EGL_DEVICE_ID chooses another." if len(devices) > 1 else ""
        return [Check("EGL device", State.GOOD, found, advice)]
    number = devices.index(int(own))
    advice = f"CUDA_VISIBLE_DEVICES={visible} does not choose what draws: MUJOCO_EGL_DEVICE_ID={number} does."
    return [Check("EGL device", State.NOTE, found, advice)]


def check_ffmpeg() -> Check:
    """The program that writes videos; a Python package contains it."""
    try:
        import imageio_ffmpeg

        return Check("ffmpeg", State.GOOD, imageio_ffmpeg.get_ffmpeg_version())
    except (ImportError, RuntimeError, OSError) as err:
        return Check("ffmpeg", State.NOTE, f"not found ({err})", "Videos need it: pip install 'anm-mj[video]'.")


def check_port() -> Check:
    """The port of the live view."""
    try:
        from anm_mj.viz.page_server import PageServer

        with closing(PageServer()) as server:
            return Check("live view", State.GOOD, f"free at {server.url} (this machine only)")
    except (ImportError, RenderError) as err:
        return Check("live view", State.NOTE, f"not possible: {err}")


def check_memory(available_mib: int | None) -> Check:
    """Available memory [MiB]; None if unknown."""
    if available_mib is None:
        return Check("memory", State.NOTE, "unknown")
    advice = "A long run may need 3 GiB: close other programs or take --preset quick."
    return _amount("memory", f"{available_mib / 1024:.1f} GiB available", available_mib >= MIN_MEMORY_MIB, advice)


def available_memory_mib() -> int | None:
    """Available memory [MiB]; None if the system does not tell."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) // 1024 for line in lines if line.startswith("MemAvailable:")), None)


def check_disk(folder: Path) -> Check:
    """Free disk space for run folders."""
    free_mib = shutil.disk_usage(folder).free // 2**20
    advice = "A long run may need 1 GiB: free some, or choose another disk with --out."
    return _amount("disk", f"{free_mib / 1024:.1f} GiB free in {folder}", free_mib >= MIN_DISK_MIB, advice)


def _amount(name: str, found: str, suffices: bool, advice: str) -> Check:
    return Check(name, State.GOOD, found) if suffices else Check(name, State.NOTE, found, advice)


def run_python(program: str) -> subprocess.CompletedProcess[str]:
    """Run a program in a Python process of its own."""
    command = [sys.executable, "-c", program]
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, 1, "", f"no answer within {_TIMEOUT_S:.0f} s")


def _last_line(text: str) -> str:
    return text.strip().rpartition("\n")[2].strip() or "no message"
