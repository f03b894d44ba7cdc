"""How much is trained on each frame that is mapped."""

from anm_mj.localisation.localisation_config import TrackingConfig
from anm_mj.types import TrainingEffort


class TrainingPace:
    """The first frames decide all later drift: they are trained on longer.

    Frames that show much that the map does not know yet become keyframes sooner, or the next frame would be registered
    to what only one batch has shown.
    """

    def __init__(self, config: TrackingConfig) -> None:
        """Before the first frame."""
        self._config = config
        self._num_mapped = 0
        self._since_keyframe = 0

    def next(self, known: float, *, has_keyframes: bool) -> TrainingEffort:
        """The effort for the next frame that is mapped, by the share of its points that the map knows. Without any
        keyframe it becomes one, as the field needs one to replay.
        """
        config = self._config
        self._num_mapped += 1
        fresh = self._num_mapped <= config.young_frames or known < config.familiar
        self._since_keyframe += 1
        every = config.fresh_keyframe_every if fresh else config.keyframe_every
        is_keyframe = self._num_mapped == 1 or not has_keyframes or self._since_keyframe >= every
        if is_keyframe:
            self._since_keyframe = 0
        return TrainingEffort(config.young_iterations if fresh else config.iterations, config.current_rays, is_keyframe)
