"""Which engine a map is trained by, and why."""

from __future__ import annotations

import importlib
import logging
from dataclasses import replace
from typing import Literal, NamedTuple

from anm_mj.errors import MapError
from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.backends.torch_backend import TorchBackend, resolve_device
from anm_mj.mapping.config import MappingConfig

_LOG = logging.getLogger(__name__)

Engine = Literal["native", "torch"]


class EngineChoice(NamedTuple):
    """The engine to use and the reason in a few words."""

    name: Engine
    reason: str
    fallback: bool = False
    """Whether a quicker engine should have been there."""


def native_fault() -> str | None:
    """Why the native engine cannot be used here; None if it can."""
    try:
        module = importlib.import_module("anm_mj.mapping.backends._native")
    except ModuleNotFoundError:
        return "it was not built; install a C++17 compiler (apt install g++) and run make setup"
    except ImportError as err:
        return f"it does not load ({err}); run make setup"
    return None if module.kernel_names() else "this processor has no SSE4.2"


def choose_engine(engine: str = "auto", device: str = "auto") -> EngineChoice:
    """The engine for a configuration's ``engine`` on a device.

    Args:
        engine: "auto" (torch on CUDA, else native where it works, else torch), "native" or "torch".
        device: "auto", "cpu" or "cuda".

    Raises:
        MapError: If engine or device are unknown, or what is asked for by name is not there.
    """
    if engine not in ("auto", "native", "torch"):
        raise MapError(f"The mapping engine is {engine!r}, but it must be 'auto', 'native' or 'torch'.")
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
    if cuda:
        return EngineChoice("torch", "it runs on the GPU")
    fault = native_fault()
    if fault is not None:
        return EngineChoice("torch", f"the native engine is missing: {fault}", fallback=True)
    return EngineChoice("native", "the quickest on a CPU")


def make_backend(config: MappingConfig, *, seed: int, device: str = "auto") -> MapperBackend:
    """The engine that ``config.engine`` and ``device`` ask for, with start values drawn from ``seed``.

    Raises:
        MapError: If it cannot be had, see :func:`choose_engine`.
    """
    choice = choose_engine(config.engine, device)
    if choice.fallback:
        _LOG.warning("The map is trained by torch, many times slower, because %s.", choice.reason)
    if choice.name == "torch":
        return TorchBackend(config, seed=seed, device=device)
    # The compiled module is there, as was found just now, but need not be.
    from anm_mj.mapping.backends.native_backend import NativeBackend

    return NativeBackend(config, seed=seed)


def with_available_engine(config: MappingConfig) -> MappingConfig:
    """The same configuration, with an engine that this machine lacks replaced by "auto".

    A map can be loaded where another engine runs than the one that trained it.
    """
    missing = config.engine == "native" and native_fault() is not None
    return replace(config, engine="auto") if missing else config
