"""Chooses the engine that trains the map: C++ on the CPU, torch on a GPU that was asked for.

Torch is imported only where it computes: a run with the native engine saves its seconds and its hundreds of megabytes.
"""

from anm_mj.errors import MapError
from anm_mj.mapping.backends.backend import MapperBackend, Parameters
from anm_mj.mapping.mapping_config import DEVICES, MappingConfig


def choose_engine(engine: str, device: str) -> str:
    """The engine that computes: "native", "torch" or "mlp". ``engine`` is one of
    :data:`anm_mj.mapping.mapping_config.ENGINES`; "auto" is torch on the device "cuda", else native. Raises MapError if
    the device is unknown, or the engine cannot run on it.
    """
    if device not in DEVICES:
        raise MapError(f"The mapping device is {device!r}, but it must be 'auto', 'cpu' or 'cuda'.")
    if (engine, device) == ("native", "cuda"):
        raise MapError("The mapping engine is 'native' and the device 'cuda', but it runs on the CPU; use 'torch'.")
    if engine == "auto":
        return "torch" if device == "cuda" else "native"
    return engine


def make_backend(
    config: MappingConfig, *, seed: int, device: str = "auto", parameters: Parameters | None = None
) -> MapperBackend:
    """The engine that ``config.engine`` and ``device`` ask for. ``parameters`` None = the start values, drawn from
    ``seed``; ``device`` is ``auto``, ``cpu`` or ``cuda``. Raises MapError if the device is unknown or absent, or the
    engine cannot run on it.
    """
    name = choose_engine(config.engine, device)
    if name == "native":
        from anm_mj.mapping.backends.native_backend import NativeBackend

        return NativeBackend(config, seed=seed, parameters=parameters)
    if name == "torch":
        from anm_mj.mapping.backends.torch_backend import TorchBackend as backend_class
    else:
        from anm_mj.mapping.backends.mlp_backend import MlpBackend as backend_class
    backend = backend_class(config, seed=seed, device=device)
    if parameters is not None:
        backend.set_parameters(parameters)
    return backend
