"""Chooses the engine that trains the map, and says why.

``auto`` is the native engine wherever it was built, also beside a GPU, else torch. No figures say yet what the Triton
engine is worth on a GPU, so it runs only when ``mapping.engine=triton`` asks for it. Torch is imported only where an
answer depends on it: a run with the native engine saves its seconds and its hundreds of megabytes.
"""

from __future__ import annotations

import importlib
import importlib.util
import logging
import os
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float32

from anm_mj.errors import MapError
from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.config import ENGINES, MappingConfig

_LOG = logging.getLogger(__name__)

DEVICES = ("auto", "cpu", "cuda")

Engine = Literal["native", "triton", "torch", "mlp"]


class EngineChoice(NamedTuple):
    """The chosen engine and the reason in a few words."""

    name: Engine
    reason: str
    instead_of: Engine | None = None
    """The faster engine that cannot run here."""


def native_fault() -> str | None:
    """Why the native engine cannot run here; None if it can."""
    try:
        module = importlib.import_module("anm_mj._native")
    except ModuleNotFoundError:
        compiler = next((path for path in map(shutil.which, ("c++", "g++", "clang++")) if path), None)
        if compiler is not None:
            return f"it was not built, though there is a compiler ({compiler}); run make setup, which says why"
        return "it was not built; install a C++17 compiler (apt install g++) and run make setup"
    except ImportError as err:
        return f"it does not load ({err}); run make setup"
    return None if module.kernel_names() else "this processor has no SSE4.2"


def triton_fault() -> str | None:
    """Why the Triton engine cannot run here; None if it can.

    Triton's interpreter runs the kernels on the host where ``TRITON_INTERPRET=1`` asks for it, as tests do.
    """
    import torch

    if not torch.cuda.is_available() and os.environ.get("TRITON_INTERPRET") != "1":
        return "there is no CUDA device"
    if importlib.util.find_spec("triton") is None:
        told = "not installed (pip install triton)" if sys.platform == "linux" else f"not made for {sys.platform}"
        return f"Triton is {told}"
    return None


def choose_engine(engine: str = "auto", device: str = "auto") -> EngineChoice:
    """The engine for a configuration's ``engine`` on a device.

    Args:
        engine: one of ``ENGINES``. "auto" is native where it was built, unless ``device`` is "cuda", else torch.
        device: "auto", "cpu" or "cuda".

    Raises:
        MapError: engine or device are unknown, or the engine that was asked for cannot run here.
    """
    if engine not in ENGINES:
        raise MapError(f"The mapping engine is {engine!r}, but it must be one of {', '.join(ENGINES)}.")
    if (engine, device) == ("native", "cuda"):
        raise MapError("The mapping engine is 'native' and the device 'cuda', but it runs on the CPU; use 'torch'.")
    if device not in DEVICES:
        raise MapError(f"The mapping device is {device!r}, but it must be 'auto', 'cpu' or 'cuda'.")
    if device == "cuda":
        _require_cuda()
    if engine == "native":
        fault = native_fault()
        if fault is not None:
            raise MapError(f"The native mapping engine was asked for, but {fault}, or use engine 'torch'.")
    elif engine == "triton":
        import torch

        fault = "it needs a CUDA device" if device == "cpu" and torch.cuda.is_available() else triton_fault()
        if fault is not None:
            raise MapError(f"The Triton mapping engine was asked for, but {fault}; use engine 'auto' or 'torch'.")
    elif engine == "auto":
        if device == "cuda":
            return EngineChoice("torch", "the device 'cuda' was asked for")
        fault = native_fault()
        if fault is not None:
            return EngineChoice("torch", f"the native engine is missing: {fault}", instead_of="native")
        return EngineChoice("native", "the default wherever it was built")
    return EngineChoice(engine, "asked for")


def make_backend(
    config: MappingConfig,
    *,
    seed: int,
    device: str = "auto",
    state: dict[str, Float32[np.ndarray, "..."]] | None = None,
) -> MapperBackend:
    """The engine that ``config.engine`` and ``device`` ask for.

    Args:
        config: The mapping configuration.
        seed: What the start values are drawn from.
        device: ``auto``, ``cpu`` or ``cuda``.
        state: Parameters by name to start with; None = the start values.

    Raises:
        MapError: see :func:`choose_engine`.
    """
    choice = choose_engine(config.engine, device)
    if choice.instead_of is not None:
        _LOG.warning("The map is trained by torch, slower than by %s, because %s.", choice.instead_of, choice.reason)
    if choice.name == "native":
        from anm_mj.mapping.backends.native_backend import NativeBackend  # It cannot be imported everywhere.

        return NativeBackend(config, seed=seed, state=state)
    backend = _torch_backend(choice.name)(config, seed=seed, device=device)
    if state is not None:
        backend.set_state(state)
    return backend


def _torch_backend(name: str) -> Callable[..., MapperBackend]:
    """The class of an engine that imports torch; Triton's cannot be imported everywhere."""
    if name == "torch":
        from anm_mj.mapping.backends.torch_backend import TorchBackend

        return TorchBackend
    if name == "mlp":
        from anm_mj.mapping.backends.mlp_backend import MlpBackend

        return MlpBackend
    from anm_mj.mapping.backends.triton.backend import TritonBackend

    return TritonBackend


def with_available_engine(config: MappingConfig) -> MappingConfig:
    """The same configuration with "auto" in place of an engine that cannot run here.

    Checkpoints are interchangeable, so a map loads on machines that lack the engine that trained it.
    """
    faults = {"native": native_fault, "triton": triton_fault}
    missing = config.engine in faults and faults[config.engine]() is not None
    return replace(config, engine="auto") if missing else config


def _require_cuda() -> None:
    """Raise a MapError unless torch finds a CUDA device."""
    from anm_mj.mapping.backends.tensor_backend import resolve_device

    resolve_device("cuda")
