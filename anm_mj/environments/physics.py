"""The simulated robot behind dm_control's ``Physics`` interface."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, Any

from dm_control.rl import control

from anm_mj.control.action_motion import action_profile
from anm_mj.control.speed_and_acceleration import MotionLimits
from anm_mj.environments.actions import CONTROL_S
from anm_mj.errors import TaskError
from anm_mj.scene.folder import Scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.sim.simulation_config import SimulationConfig
from anm_mj.types import Action, ActionResult, MotionResult, Pose2, Twist

if TYPE_CHECKING:
    from anm_mj.sim.sim_robot import SimRobot


class RobotPhysics(control.Physics):
    """A simulated robot whose step is one discrete action, or a velocity that holds for a time.

    The first ``place`` creates simulator and GL context. Gymnasium's vector environments create an environment for its
    specifications alone and then fork; such an environment must not hold a GL context.
    """

    def __init__(self, config: SimulationConfig) -> None:
        self._config = config
        self._scene: Scene | None = None
        self._robot: SimRobot | None = None
        self._action: Action | Twist = Action.STOP
        self.result: ActionResult | MotionResult | None = None
        """Result of the last action; None at the start of an episode."""

    def __getstate__(self) -> dict[str, Any]:
        """What copies and pickles keep. Raises TaskError once there is a simulation, which cannot be copied."""
        if self._robot is not None:
            raise TaskError(
                "An environment cannot be copied or pickled after its first reset, because it holds a simulation: copy "
                "it before, or make another one, reset it with the same seed and repeat the actions."
            )
        return self.__dict__

    @property
    def robot(self) -> SimRobot:
        """The robot; available from the first ``place`` on."""
        assert self._robot is not None
        return self._robot

    def reset(self) -> None:
        """Forget the last action; ``place`` moves the robot to its start."""
        self._action, self.result = Action.STOP, None

    def after_reset(self) -> None:
        """Do nothing: ``place`` has reset the simulation."""

    def place(self, scene: Scene, pose: Pose2, seed: int) -> None:
        """Reset the simulation to time 0 with the robot at rest at a pose; another scene than before is loaded first.

        ``seed`` is that of the sensor's errors, and of where people begin and go. Raises SceneError if the scene cannot
        be built, or the robot does not fit at the pose, and RenderError if no GL back-end works.
        """
        if self._robot is None or scene is not self._scene:
            self.close()
            # People keep the bodies that they were made with: those of one seed, whatever episodes there were before.
            robot = make_robot(scene, self._config, start=pose)
            self._scene = scene
            # Free GL before the interpreter unloads its modules, also in programs that never call ``close``.
            self._close = weakref.finalize(self, robot.close)
            self._robot = robot
        self.robot.restart(pose, seed=seed)

    def set_control(self, control: Action | Twist) -> None:
        """Set the action, or the velocity, of the next step."""
        self._action = control

    def step(self, n_sub_steps: int = 1) -> None:
        """Execute the action to its end, ``n_sub_steps`` times."""
        for _ in range(n_sub_steps):
            if isinstance(self._action, Twist):
                self.result = self.robot.drive(self._action, CONTROL_S)
            else:
                self.result = self.robot.act(self._action)

    def time(self) -> float:
        """Simulated time since the start of the episode [s]."""
        return float(self.robot.data.time)

    def timestep(self) -> float:
        """Duration of a forward step [s]; a turn takes less, a blocked step may take more."""
        return action_profile(Action.MOVE_FORWARD, MotionLimits()).duration_s

    def close(self) -> None:
        """Free the GL context; may be called again. The next ``place`` creates a new robot."""
        if self._robot is not None:
            self._close()
            self._robot = None
