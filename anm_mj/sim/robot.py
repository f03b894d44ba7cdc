"""The simulated robot behind the :class:`anm_mj.protocols.Robot` protocol."""

from __future__ import annotations

import mujoco

from anm_mj.protocols import Drive
from anm_mj.sim.camera import RgbdCamera
from anm_mj.types import Action, ActionResult, Footprint, Observation, Pose2


class SimRobot:
    """A robot in a MuJoCo simulation: a drive that moves it and a camera that looks.

    Close it, or use it in a ``with`` statement, to free the camera's GL context.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        camera: RgbdCamera,
        drive: Drive,
        footprint: Footprint,
    ):
        """Put the parts together; model and data are the ones that camera and drive work on."""
        self._model = model
        self._data = data
        self._camera = camera
        self._drive = drive
        self._footprint = footprint
        self._step = 0

    @property
    def footprint(self) -> Footprint:
        """The cylinder that must stay clear of obstacles."""
        return self._footprint

    @property
    def pose(self) -> Pose2:
        """Where the base truly stands now."""
        return self._drive.pose

    @property
    def step(self) -> int:
        """Number of actions executed so far, refused ones included and STOP not."""
        return self._step

    @property
    def model(self) -> mujoco.MjModel:
        """The simulated model."""
        return self._model

    @property
    def data(self) -> mujoco.MjData:
        """The simulation's state."""
        return self._data

    def observe(self) -> Observation:
        """The view from where the robot stands now, with true poses.

        Raises:
            RenderError: after ``close``.
        """
        # Whatever moved the joints, in one step or many, the poses of bodies and cameras lag behind until computed.
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        rgb, depth_m = self._camera.render(self._data)
        return Observation(
            step=self._step,
            time_s=float(self._data.time),
            rgb=rgb,
            depth_m=depth_m,
            intrinsics=self._camera.intrinsics,
            T_world_camera=self._camera.T_world_camera(self._data),
            pose=self._drive.pose,
        )

    def act(self, action: Action) -> ActionResult:
        """Execute one action to its end and say what came of it."""
        result = self._drive.act(action)
        self._step += action != Action.STOP
        return result

    def restart(self, pose: Pose2) -> None:
        """Begin anew at a pose: at rest, at time and step 0, everything else in the scene where it was at first."""
        mujoco.mj_resetData(self._model, self._data)
        self._drive.place(pose)
        self._step = 0

    def close(self) -> None:
        """Free the camera's GL context; may be called again."""
        self._camera.close()

    def __enter__(self) -> SimRobot:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()
