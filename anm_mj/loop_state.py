"""What the loop itself remembers between two steps."""

from anm_mj.control.path_follower import Follower
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.sensing.moving_things import MovingThings
from anm_mj.sensing.sensor_monitor import SensorMonitor
from anm_mj.types import Observation, Plan
from anm_mj.utils.stopwatch import Stopwatch


class LoopState:
    """Where a run stands; a checkpoint holds it, and a run goes on from it."""

    def __init__(self, patience_steps: int = PlanningConfig.patience_steps) -> None:
        """Before the first observation; ``patience_steps`` is that of :class:`PlanningConfig`."""
        self.patience_steps = patience_steps
        self.things = MovingThings()
        """What moves about the robot."""
        self.waited = 0
        """Steps in a row, for what moves in the way."""
        self.doubted_stops = 0
        """Decisions in a row to end the run that were put off, because something moves about."""
        self.step = 0
        """Number of actions so far."""
        self.follower = Follower()
        self.monitor = SensorMonitor()
        self.total = Stopwatch()
        """Time spent in the loop, without set-up and observers."""
        self.collisions = 0
        """On paths, without a free step in between."""
        self.blind_turns = 0
        """In place of forward moves that nothing was seen ahead of, since the last free one."""
        self.lost_steps = 0
        """Since the pose was known the last time."""
        self.map_failed = False
        """Whether the map cannot be trained any further."""
        self.plan: Plan | None = None
        self.observation: Observation | None = None
        """The last one."""

    @property
    def loop_s(self) -> float:
        """Time spent in the loop so far [s]."""
        return sum(self.total.ms.values()) / 1e3
