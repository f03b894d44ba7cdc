"""What a run folder keeps besides its numbers, for replay, film and exports."""

from dataclasses import dataclass

from anm_mj.errors import RunFolderError
from anm_mj.utils.settings import Settings, setting

IMAGE_SIZES = ("none", "small", "full")


@dataclass(frozen=True)
class RecordConfig(Settings, group="record", error=RunFolderError):
    """What is kept of the observations and decisions; no other file of the run depends on it."""

    images: str = setting("small", choices=IMAGE_SIZES)
    """Colour images: ``none``, ``small`` (128 pixels, about 4 KB each) or ``full`` (as the camera gave them)."""
    replay_bytes: int = setting(16_000_000, at_least=0, at_most=64e9)
    """Memory for keyframes in ``explored.safetensors``, which a later run goes on from [bytes]: all of them are thinned
    to fit. 0 = the file is not written, and no run goes on from this one."""
    plans: bool = True
    """Whether the map, graph, regions and path of every decision are kept, about 10 KB each."""
