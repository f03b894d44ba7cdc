"""A robot that begins with what its next actions will show, while the run learns, records and decides."""

import math

from anm_mj.control.path_follower import Follower
from anm_mj.events import Located, Stepped
from anm_mj.loop_state import LoopState
from anm_mj.planning.steps_ahead import in_the_way
from anm_mj.protocols import Anticipates, Robot
from anm_mj.types import Action, ActionResult, Footprint, MotionResult, Observation, Twist


class AnticipatingRobot:
    """Wraps a robot for the loop, and hears the loop's events; what the robot does and sees stays the same."""

    def __init__(self, robot: Robot, state: LoopState) -> None:
        """Wrap a robot; one that cannot anticipate behaves as without the wrapper. ``state`` is where the loop stands;
        its follower tells the next actions.
        """
        self._robot, self._state = robot, state
        self._ahead = robot if isinstance(robot, Anticipates) else None
        self._repeated: Action | None = None
        """The action that a decision would most likely repeat; None = no guess."""

    @property
    def footprint(self) -> Footprint:
        """Of the robot."""
        return self._robot.footprint

    def act(self, action: Action) -> ActionResult:
        """Execute one action to its end."""
        result = self._robot.act(action)
        self._repeated = None if result.collided else action
        return result

    def drive(self, twist: Twist, duration_s: float) -> MotionResult:
        """Move at a velocity for a time [s]."""
        return self._robot.drive(twist, duration_s)

    def observe(self) -> Observation:
        """The view from the present pose."""
        return self._robot.observe()

    def on_event(self, event: object) -> None:
        """Begin with the next action before the run learns, and after the step with one more, which comes true while
        the run records, decides and moves.
        """
        if self._ahead is not None and isinstance(event, Located | Stepped):
            count = 1 if isinstance(event, Located) else 2
            self._ahead.anticipate(*self._coming_actions(event.observation)[:count])

    def _coming_actions(self, seen: Observation) -> list[Action]:
        """The next two actions after an observation, as far as they can be told.

        Where a path ends, a decision follows, and most begin with what the robot did last: to go on, or to turn on. A
        policy that gives single actions may want another one next. A pose that is not finite says nothing.
        """
        pose = seen.pose
        if not all(map(math.isfinite, (pose.x_m, pose.y_m, pose.yaw_rad))):
            return []
        follower: Follower = self._state.follower
        coming = follower.coming_actions(pose, 2)
        if len(coming) < 2 and self._repeated is not None and not follower.has_fixed_actions:
            coming.append(coming[-1] if coming else self._repeated)
        waits_for = in_the_way(self._state.things.things, self.footprint, pose, seen.time_s)
        if waits_for is not None and coming[:1] == [Action.MOVE_FORWARD]:
            return [Action.WAIT]
        return coming
