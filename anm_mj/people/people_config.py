"""Who walks through a scene."""

from dataclasses import dataclass

from anm_mj.errors import ConfigError
from anm_mj.utils.settings import Settings, setting


@dataclass(frozen=True)
class PeopleConfig(Settings, group="people", error=ConfigError):
    """Settings of the people in a scene; without people only vacuum robots and the chair move."""

    number: int = setting(0, at_least=0, at_most=100)
    """How many walk through the scene."""
    slowest_mps: float = setting(0.4, at_least=0.1, at_most=2.0)
    """Each walks at a speed of its own from here on [m/s]."""
    fastest_mps: float = setting(1.2, at_least=0.1, at_most=2.0)
    """Up to here [m/s]."""
    longest_stand_s: float = setting(10.0, at_least=0.0)
    """They stand at each place that they walk to, up to so long [s]."""
    followers: int = setting(0, at_least=0)
    """So many of them follow the robot instead of walking about."""
    blocked_s: float = setting(0.0, at_least=0.0)
    """The first one stands in the doorway nearest to the robot's start for so long before it walks about [s]."""
    vacuums: int = setting(0, at_least=0, at_most=100)
    """So many vacuum robots drive about on the floor."""
    chair_pushed_s: float = setting(0.0, at_least=0.0)
    """A chair stands on the floor, and is pushed 0.7 m aside after so long [s]; 0 = there is none."""
    doors: int = setting(0, at_least=0, at_most=100)
    """Leaves hang in so many doorways, those nearest to the robot's start, shut until a person passes."""

    @property
    def has_chair(self) -> bool:
        """Whether there is one that is pushed."""
        return self.chair_pushed_s > 0.0

    @property
    def num_bodies(self) -> int:
        """How many move through the scene: people, vacuum robots and the chair; doors have places of their own."""
        return self.number + self.vacuums + self.has_chair

    def __post_init__(self) -> None:
        """Check the settings. Raises ConfigError if one is out of range, or contradicts another."""
        super().__post_init__()
        if self.slowest_mps > self.fastest_mps:
            raise ConfigError(
                f"people.slowest_mps is {self.slowest_mps:g}; it must be at most fastest_mps, {self.fastest_mps:g}."
            )
        if self.followers > self.number:
            raise ConfigError(
                f"people.followers is {self.followers}, but people.number is {self.number}; give no more followers "
                "than people."
            )
        if self.blocked_s > 0.0 and self.followers == self.number:
            raise ConfigError(
                f"people.blocked_s is {self.blocked_s:g}, but people.number is {self.number} and people.followers "
                f"{self.followers}, so that nobody stands in a doorway; give somebody who does not follow, or no "
                "people.blocked_s."
            )
        if self.doors > 0 and self.number == 0:
            raise ConfigError(
                f"people.doors is {self.doors}, but people.number is 0, so that nobody opens them; give people, or no "
                "doors."
            )
        if self.doors > 0 and self.blocked_s > 0.0:
            raise ConfigError(
                f"people.doors is {self.doors} and people.blocked_s is {self.blocked_s:g}: a leaf would hang in the "
                "doorway in which somebody stands; give only one of them."
            )
