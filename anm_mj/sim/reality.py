"""How much of what makes the world hard a simulation has, in one word: ``ideal`` or ``real``.

A reality stands for options and settings of a run; whatever is given beside it goes before it. This is the only place
that says which.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from anm_mj.errors import ConfigError
from anm_mj.utils.close_names import close_name


class Reality(NamedTuple):
    """What a name stands for."""

    options: Mapping[str, str]
    """``drive``, ``pose`` and ``sensor``, as of :class:`~.simulation_config.SimulationConfig`."""
    settings: Mapping[str, Mapping[str, Any]]
    """Values by group and name."""

    @property
    def texts(self) -> tuple[str, ...]:
        """The settings as ``group.name=value``, without blanks."""
        pairs = ((f"{group}.{name}", value) for group, own in self.settings.items() for name, value in own.items())
        return tuple(f"{name}={value}".replace(" ", "") for name, value in pairs)


IDEAL = "ideal"
REALITIES: dict[str, Reality] = {
    # Exact images without delay, exact poses, exact motions, nobody else: the world of the paper.
    IDEAL: Reality({}, {}),
    # A stereo camera, wheels that slip by the odometry motion model (Thrun, Burgard and Fox, 2005, table 5.6), encoders
    # that err by two to three degrees in a hundred actions, torque and contact, three people, images that come late.
    "real": Reality(
        {"drive": "physics", "pose": "slam", "sensor": "d435i"},
        {
            "model": {"wheel_noise": 0.02},
            "sensor": {"odometry_alpha": (0.01, 0.01, 0.01, 0.01), "delay_s": 0.1},
            "people": {"number": 3},
        },
    ),
}


def reality_of(name: str) -> Reality:
    """What a name stands for. Raises ConfigError if there is no such reality."""
    if name not in REALITIES:
        raise ConfigError(
            f"There is no reality '{name}'{close_name(name, REALITIES)}; choose one of {', '.join(REALITIES)}."
        )
    return REALITIES[name]
