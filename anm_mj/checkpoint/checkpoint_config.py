"""How often a run is stored."""

from dataclasses import dataclass

from anm_mj.errors import CheckpointError
from anm_mj.utils.settings import Settings, setting


@dataclass(frozen=True)
class CheckpointConfig(Settings, group="checkpoint", error=CheckpointError):
    """When checkpoints are written."""

    every_steps: int = setting(100, at_least=0, at_most=1e9)
    """Steps from one checkpoint to the next; 0 = none are written."""
    loop_share: float = setting(0.01, at_most=1.0)
    """The loop spends at most this share of its time on checkpoints; where one takes long, the next one waits. 1 = they
    never wait."""
