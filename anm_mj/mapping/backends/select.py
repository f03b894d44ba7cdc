"""Which engine a map is trained by, and why."""

from __future__ import annotations

import importlib
import importlib.util
import logging
import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple

import torch

from anm_mj.errors import MapError
from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.backends.mlp_backend import MlpBackend
from anm_mj.mapping.backends.torch_backend import TorchBackend, resolve_device
from anm_mj.mapping.config import MappingConfig

_LOG = logging.getLogger(__name__)

Engine = Literal["native", "triton", "torch", "mlp"]


class EngineChoice(NamedTuple):
    """The engine to use and the reason in a few words."""

    name: Engine
    reason: str
    instead_of: Engine | None = None
    """The quicker engine that should have been there."""


def native_fault() -> str | None:
    """Why the native engine cannot be used here; None if it can."""
    try:
        module = importlib.import_module("anm_mj.mapping.backends._native")
    except ModuleNotFoundError:
        compiler = next((path for path in map(shutil.which, ("c++", "g++", "clang++")) if path), None)
        if compiler is not None:
            return f"it was not built, though there is a compiler ({compiler}); run make setup, which says why"
        return "it was not built; install a C++17 compiler (apt install g++) and run make setup"
    except ImportError as err:
        return f"it does not load ({err}); run make setup"
    return None if module.kernel_names() else "this processor has no SSE4.2"


def triton_fault() -> str | None:
    """Why the Triton engine cannot be used here; None if it can.

    Where nothing else stands against it, the first call compiles its kernels and compares a few steps with torch.
    """
    if not torch.cuda.is_available() and not _interpreted():
        return "there is no CUDA device"
    if _software_renderer():
        return "this process has rendered in software before, and Triton's LLVM crashes if loaded beside the renderer's"
    if importlib.util.find_spec("triton") is None:
        told = "not installed (pip install triton)" if sys.platform == "linux" else f"not made for {sys.platform}"
        return f"Triton is {told}"
    try:
        module = importlib.import_module("anm_mj.mapping.backends.triton.self_check")
    except ImportError as err:
        return f"it does not load ({err})"
    return module.self_check()


def _interpreted() -> bool:
    """Whether Triton's kernels are to run in its interpreter, on the host, as in tests."""
    return os.environ.get("TRITON_INTERPRET") == "1"


def _software_renderer() -> bool:
    """Whether this process has rendered in software; Triton crashes if loaded after that, and does not before it."""
    try:
        return "libLLVM" in Path("/proc/self/maps").read_text()
    except OSError:
        # Not Linux, for which alone Triton is made.
        return False


def choose_engine(engine: str = "auto", device: str = "auto") -> EngineChoice:
    """The engine for a configuration's ``engine`` on a device.

    Args:
        engine: "auto" (on CUDA Triton where it works, else torch; on a CPU native where it works, else torch),
            "native", "triton", "torch", or "mlp" (another map, see :mod:`anm_mj.mapping.backends.mlp_backend`).
        device: "auto", "cpu" or "cuda".

    Raises:
        MapError: If engine or device are unknown, or what is asked for by name is not there.
    """
    if engine not in ("auto", "native", "triton", "torch", "mlp"):
        raise MapError(
            f"The mapping engine is {engine!r}, but it must be 'auto', 'native', 'triton', 'torch' or 'mlp'."
        )
    if engine == "mlp":
        return EngineChoice("mlp", "asked for")
    if engine == "native":
        # A GPU that nobody asked for is no reason to refuse.
        if device == "cuda":
            raise MapError("The mapping engine is 'native' and the device 'cuda', but it runs on the CPU; use 'torch'.")
        resolve_device(device)
        fault = native_fault()
        if fault is not None:
            raise MapError(f"The native mapping engine was asked for, but {fault}, or use engine 'torch'.")
        return EngineChoice("native", "asked for")
    cuda = resolve_device(device).type == "cuda"
    if engine == "torch":
        return EngineChoice("torch", "asked for")
    if engine == "triton":
        fault = triton_fault() if cuda or _interpreted() else "it needs a CUDA device"
        if fault is not None:
            raise MapError(f"The Triton mapping engine was asked for, but {fault}; use engine 'auto' or 'torch'.")
        return EngineChoice("triton", "asked for")
    if cuda:
        fault = triton_fault()
        if fault is not None:
            return EngineChoice("torch", f"the Triton engine cannot be used: {fault}", instead_of="triton")
        return EngineChoice("triton", "the quickest on a GPU")
    fault = native_fault()
    if fault is not None:
        return EngineChoice("torch", f"the native engine is missing: {fault}", instead_of="native")
    return EngineChoice("native", "the quickest on a CPU")


def make_backend(config: MappingConfig, *, seed: int, device: str = "auto") -> MapperBackend:
    """The engine that ``config.engine`` and ``device`` ask for, with start values drawn from ``seed``.

    Raises:
        MapError: If it cannot be had, see :func:`choose_engine`.
    """
    choice = choose_engine(config.engine, device)
    if choice.instead_of is not None:
        _LOG.warning("The map is trained by torch, slower than by %s, because %s.", choice.instead_of, choice.reason)
    if choice.name == "torch":
        return TorchBackend(config, seed=seed, device=device)
    if choice.name == "mlp":
        return MlpBackend(config, seed=seed, device=device)
    if choice.name == "triton":
        # Triton is not made for every platform.
        from anm_mj.mapping.backends.triton.backend import TritonBackend

        return TritonBackend(config, seed=seed, device=device)
    # The compiled module is there, as was found just now, but need not be.
    from anm_mj.mapping.backends.native_backend import NativeBackend

    return NativeBackend(config, seed=seed)


def with_available_engine(config: MappingConfig) -> MappingConfig:
    """The same configuration, with an engine that this machine lacks replaced by "auto".

    A map can be loaded where another engine runs than the one that trained it.
    """
    faults = {"native": native_fault, "triton": triton_fault}
    missing = config.engine in faults and faults[config.engine]() is not None
    return replace(config, engine="auto") if missing else config
