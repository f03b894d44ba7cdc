"""An empty neural map by the name of its preset."""

from anm_mj.errors import MapError
from anm_mj.mapping.mapping_config import MAPPING_PRESETS
from anm_mj.mapping.neural_map import NeuralMap


def make_map(preset: str = "default", *, seed: int = 0, device: str = "auto") -> NeuralMap:
    """An empty neural map; ``integrate`` it with observations. Raises MapError if there is no such preset, or the
    device is unknown or absent.

    Args:
        preset: mapping effort: a key of :data:`anm_mj.mapping.mapping_config.MAPPING_PRESETS`.
        seed: of start values, rays and jitter.
        device: ``auto``, ``cpu`` or ``cuda``.
    """
    if preset not in MAPPING_PRESETS:
        raise MapError(f"There is no mapping preset '{preset}'; choose one of {', '.join(MAPPING_PRESETS)}.")
    return NeuralMap(MAPPING_PRESETS[preset](), seed=seed, device=device)
