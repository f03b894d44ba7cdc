"""The robot in its scene, as dm_control's environments ask a simulation to be."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING

from dm_control.rl import control

from anm_mj.control.motion import MotionLimits, action_profile
from anm_mj.scene.folder import Scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.types import Action, ActionResult, Observation, Pose2

if TYPE_CHECKING:
    from anm_mj.sim.robot import SimRobot


class RobotWorld(control.Physics):
    """A simulated robot whose step is one discrete action.

    Simulator and GL context are made when the robot is first placed and not before: an environment that is only asked
    for its specifications, as Gymnasium's vector environments do before they fork, must not hold a GL context.
    """

    def __init__(self, scene: Scene, *, drive: str, image_px: int) -> None:
        """Remember what to simulate.

        Args:
            scene: the world.
            drive: how actions are executed.
            image_px: width and height of the camera's pictures [px].
        """
        self._scene = scene
        self._drive = drive
        self._image_px = image_px
        self._robot: SimRobot | None = None
        self._action = Action.STOP
        self._result: ActionResult | None = None

    @property
    def robot(self) -> SimRobot:
        """The robot; there is one from the first ``place`` on."""
        assert self._robot is not None
        return self._robot

    @property
    def result(self) -> ActionResult | None:
        """What the last action came to; None at the start of an episode."""
        return self._result

    def reset(self) -> None:
        """Forget the last action; the robot goes to its start by ``place``."""
        self._action, self._result = Action.STOP, None

    def after_reset(self) -> None:
        """Nothing is left to be done after ``place``."""

    def place(self, pose: Pose2) -> None:
        """Put the robot at the start of an episode, at rest, at time 0, and everything else where it was.

        Raises:
            SceneError: if the scene cannot be built, or the robot does not fit there.
            RenderError: if no GL back-end works.
        """
        if self._robot is not None:
            self._robot.restart(pose)
            return
        robot = make_robot(self._scene, start=pose, drive=self._drive, image_px=self._image_px)
        # GL must be freed before the interpreter takes its modules apart, and many a program ends without ``close``.
        self._close = weakref.finalize(self, robot.close)
        self._robot = robot

    def set_control(self, control: Action) -> None:
        """The action that the next step executes."""
        self._action = control

    def step(self, n_sub_steps: int = 1) -> None:
        """Execute the action to its end, ``n_sub_steps`` times."""
        for _ in range(n_sub_steps):
            self._result = self.robot.act(self._action)

    def observe(self) -> Observation:
        """The view from where the robot stands now."""
        return self.robot.observe()

    def time(self) -> float:
        """Simulated time since the start of the episode [s]."""
        return float(self.robot.data.time)

    def timestep(self) -> float:
        """Simulated time that a step forward takes [s]; a turn takes a little less, a blocked step may take more."""
        return action_profile(Action.MOVE_FORWARD, MotionLimits()).duration_s

    def close(self) -> None:
        """Free the GL context; may be called again. The next ``place`` makes a new robot."""
        if self._robot is not None:
            self._close()
            self._robot = None
