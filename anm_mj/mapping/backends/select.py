"""Chooses the engine that trains the map: C++ on the CPU, torch on a GPU that was asked for.

Torch is imported only where an answer depends on it: a run with the native engine saves its seconds and its hundreds of
megabytes.
"""

from __future__ import annotations

from typing import Literal

from anm_mj.errors import MapError
from anm_mj.mapping.backends.backend import MapperBackend, Parameters
from anm_mj.mapping.mapping_config import ENGINES, MappingConfig

DEVICES = ("auto", "cpu", "cuda")

Engine = Literal["native", "torch", "mlp"]


def choose_engine(engine: str = "auto", device: str = "auto") -> Engine:
    """The engine for a configuration's ``engine`` on a device.

    Args:
        engine: one of ``ENGINES``; "auto" is torch where ``device`` is "cuda", else native.
        device: "auto", "cpu" or "cuda".

    Raises:
        MapError: engine or device are unknown, or the engine cannot run on the device.
    """
    if engine not in ENGINES:
        raise MapError(f"The mapping engine is {engine!r}, but it must be one of {', '.join(ENGINES)}.")
    if (engine, device) == ("native", "cuda"):
        raise MapError("The mapping engine is 'native' and the device 'cuda', but it runs on the CPU; use 'torch'.")
    if device not in DEVICES:
        raise MapError(f"The mapping device is {device!r}, but it must be 'auto', 'cpu' or 'cuda'.")
    if device == "cuda":
        from anm_mj.mapping.backends.tensor_backend import resolve_device

        resolve_device(device)
    if engine == "auto":
        return "torch" if device == "cuda" else "native"
    return engine  # type: ignore[return-value]


def make_backend(
    config: MappingConfig,
    *,
    seed: int,
    device: str = "auto",
    parameters: Parameters | None = None,
) -> MapperBackend:
    """The engine that ``config.engine`` and ``device`` ask for.

    Args:
        config: The mapping configuration.
        seed: What the start values are drawn from.
        device: ``auto``, ``cpu`` or ``cuda``.
        parameters: To start with; None = the start values.

    Raises:
        MapError: see :func:`choose_engine`.
    """
    name = choose_engine(config.engine, device)
    if name == "native":
        from anm_mj.mapping.backends.native_backend import NativeBackend

        return NativeBackend(config, seed=seed, parameters=parameters)
    if name == "torch":
        from anm_mj.mapping.backends.torch_backend import TorchBackend

        backend = TorchBackend(config, seed=seed, device=device)
    else:
        from anm_mj.mapping.backends.mlp_backend import MlpBackend

        backend = MlpBackend(config, seed=seed, device=device)
    if parameters is not None:
        backend.set_parameters(parameters)
    return backend
