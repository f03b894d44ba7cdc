"""Begins the next actions of a simulated robot, and what its camera will show after them, before they are asked for.

While the robot learns from one image and decides, the next ones are drawn in a thread of their own, if somebody knows
where they will be taken from. An image that was begun is given out only where every pose that a camera reads is the
same to the last bit, so that guesses change how long an image takes and nothing else.

Actions that roll exactly and at once need no more than the poses after them. Actions by torque and contact take as long
as an image: one is executed in a copy of the simulation. What a drive does depends on nothing but its state and the
simulation's, so that the copy's action is the action, to the last bit, if it is asked for in the state that was copied;
else it is forgotten.
"""

from __future__ import annotations

import functools
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float32

from anm_mj.people.crowd import Crowd
from anm_mj.sim.camera import Camera, Image
from anm_mj.sim.drives.kinematic_drive import KinematicDrive
from anm_mj.sim.drives.physics_drive import PhysicsDrive
from anm_mj.sim.drives.trail import Trail
from anm_mj.types import Action, ActionResult
from anm_mj.utils.threads import lent_core

_READ = (
    "geom_xpos",
    "geom_xmat",
    "site_xpos",
    "site_xmat",
    "cam_xpos",
    "cam_xmat",
    "light_xpos",
    "light_xdir",
    "flexvert_xpos",
    "ten_length",
    "ten_wrapnum",
    "wrap_xpos",
)
"""What images are made of."""
_AT_ONCE = 2
"""So many images may have been begun."""


def frame_number(data: mujoco.MjData) -> int:
    """Number of the frame of a state: its time [ms], as velocities do not count as steps."""
    return round(1e3 * data.time)


def update_poses(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Bring poses of bodies and cameras up to date, after any motion of joints."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)


def _is_same_view(a: mujoco.MjData, b: mujoco.MjData) -> bool:
    return all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in _READ)


class _Begun(NamedTuple):
    data: mujoco.MjData
    image: Future[Image]


class AheadCamera(Camera):
    """Renders with another camera, in one thread that does nothing else."""

    def __init__(self, make: Callable[[], Camera]) -> None:
        """Make the camera by ``make``, in its thread: a GL context belongs to one. Raises what ``make`` raises."""
        self._thread = ThreadPoolExecutor(1, "camera")
        try:
            self._camera = self._thread.submit(make).result()
        except BaseException:
            self._thread.shutdown()
            raise
        self.kind = self._camera.kind
        self._model = self._camera._model
        self._camera_id = self._camera._camera_id
        self.intrinsics = self._camera.intrinsics
        self._begun: list[_Begun] = []
        self._closed = False

    @property
    def num_begun(self) -> int:
        """Images that were begun and neither given out nor given up."""
        return len(self._begun)

    def begin(
        self,
        data: mujoco.MjData,
        prepare: Callable[[], object] = lambda: None,
        finish: Callable[[Image], object] = lambda _: None,
    ) -> None:
        """Begin the image after those that were begun, and return at once.

        Args:
            data: what the image shows, with all poses up to date; must not change before it is given out or given up.
            prepare: called before, in the camera's thread; may write ``data``.
            finish: called with the image, in the camera's thread.
        """
        if not self._closed:
            self._begun.append(_Begun(data, self._thread.submit(self._render_beside, data, prepare, finish)))

    def give_up(self, keep: int = 0) -> None:
        """Forget the images that were begun, but for the first ``keep``; what they were made of may change then."""
        # From the last on, so that none is started while another one is waited for.
        while len(self._begun) > keep:
            image = self._begun.pop().image
            if not image.cancel():
                image.exception()

    def render(self, data: mujoco.MjData) -> Image:
        """The first image that was begun, if it is the one; else another, and all others are given up. See
        :meth:`Camera.render`.
        """
        if self._begun and _is_same_view(self._begun[0].data, data):
            begun = self._begun.pop(0)
            if begun.image.exception() is None:
                return begun.image.result()
        self.give_up()
        if self._closed:
            return self._camera.render(data)
        return self._thread.submit(self._camera.render, data).result()

    def close(self) -> None:
        """Free the camera; may be called again."""
        if not self._closed:
            self._closed = True
            self.give_up()
            self._thread.submit(self._camera.close).result()
            self._thread.shutdown()

    def _render_beside(
        self, data: mujoco.MjData, prepare: Callable[[], object], finish: Callable[[Image], object]
    ) -> Image:
        with lent_core():
            prepare()
            image = self._camera.render(data)
            finish(image)
            return image


class _Coming(NamedTuple):
    """An action whose image was begun, and what is so after it."""

    action: Action
    data: mujoco.MjData
    """Of the image."""
    crowd: Crowd | None = None
    trail: Trail | None = None


class ViewsAhead:
    """The next actions of a drive whose images were begun."""

    def __init__(
        self,
        model: mujoco.MjModel,
        camera: AheadCamera,
        drive: KinematicDrive | PhysicsDrive,
        copied: PhysicsDrive | None,
        delay_s: float,
        measure: Callable[[Image, int], Image],
    ) -> None:
        """Begin with none of ``drive``'s actions; images are late by ``delay_s``.

        ``copied`` is another drive of the same robot, on data of its own; None for one whose actions take no time.
        ``measure`` is what the sensor makes of an exact image and the number of its frame, in any thread.
        """
        self._model, self._camera, self._drive, self._copied = model, camera, drive, copied
        self._delay_s, self._measure = delay_s, measure
        self._coming: list[_Coming] = []
        self._spare: list[mujoco.MjData] = []
        """Data that no image is made of any more."""
        self._measured: deque[tuple[Float32[np.ndarray, "h w"], int, Image]] = deque(maxlen=_AT_ONCE)
        self._state = b""
        """That the action in the copy began in."""
        self._result: Future[ActionResult] = Future()

    def begin(self, *actions: Action) -> None:
        """Begin the images after actions; see :class:`anm_mj.protocols.Anticipates`."""
        if self._copied is not None:
            actions = actions[:1]
        pairs = zip(self._coming, actions, strict=False)
        wrong = next((k for k, (known, action) in enumerate(pairs) if known.action != action), None)
        if wrong is not None:
            self.give_up(wrong)
        for number in range(len(self._coming), len(actions)):
            if isinstance(self._drive, KinematicDrive):
                self._roll(self._drive, actions[: number + 1])
            elif self._copied is not None:
                self._execute(self._drive, self._copied, actions[number])

    def take(self, action: Action) -> ActionResult | None:
        """What an action does, if it was begun in the present state; then the drive stands at its end. Else None."""
        drive, copied = self._drive, self._copied
        if copied is None or not isinstance(drive, PhysicsDrive) or not self._coming:
            return None
        is_it = self._coming[0].action is action and self._state == drive.state
        if not is_it or self._result.exception() is not None:
            self.give_up()
            return None
        drive.take_over(copied)
        self._state = b""
        return self._result.result()

    def measured(self, exact_m: Float32[np.ndarray, "h w"], frame: int) -> Image | None:
        """What the sensor makes of an image that was begun, given its depth; None if it was not."""
        done = len(self._coming) - self._camera.num_begun
        self._spare += [one.data for one in self._coming[:done]]
        del self._coming[:done]
        # A copy, made in one go: the camera's thread appends meanwhile.
        found = tuple(self._measured)
        return next((said for depth_m, number, said in found if depth_m is exact_m and number == frame), None)

    def give_up(self, keep: int = 0) -> None:
        """Forget the actions that were begun, but for the first ``keep``."""
        self._camera.give_up(keep)
        self._spare += [one.data for one in self._coming[keep:]]
        del self._coming[keep:]

    def _roll(self, drive: KinematicDrive, actions: tuple[Action, ...]) -> None:
        """Begin the image after the last of some actions, where those before it were begun."""
        data = self._unused()
        pose = drive.anticipate(actions, data)
        crowd, trail = self._coming[-1][2:] if self._coming else (drive.crowd, drive.trail)
        crowd, trail = crowd and crowd.copied(), trail and trail.copied()
        if crowd is not None and drive.figures is not None:
            if trail is None:
                crowd.follow(data.time, pose.xy_m)
                drive.figures.write(crowd, data)
            else:
                trail.follow(crowd, drive.figures, data, pose.xy_m)
        if trail is not None:
            trail.add(data, pose, drive.profile(actions[-1]))
            trail.write(data, data.time - self._delay_s)
        update_poses(self._model, data)
        self._coming.append(_Coming(actions[-1], data, crowd, trail))
        self._camera.begin(data, finish=functools.partial(self._finish, data))

    def _execute(self, drive: PhysicsDrive, copied: PhysicsDrive, action: Action) -> None:
        """Begin an action in the copy, and the image after it."""
        data, self._state, self._result = self._unused(), drive.state, Future()
        copied.take_over(drive)
        prepare = functools.partial(self._run, copied, action, self._result, data)
        self._coming.append(_Coming(action, data))
        self._camera.begin(data, prepare, functools.partial(self._finish, data))

    def _run(self, drive: PhysicsDrive, action: Action, result: Future[ActionResult], shown: mujoco.MjData) -> None:
        """Execute an action in the camera's thread, and write what its image shows."""
        try:
            result.set_result(drive.act(action))
        except BaseException as err:
            result.set_exception(err)
            raise
        if drive.trail is None:
            mujoco.mj_copyData(shown, self._model, drive.data)
        else:
            trail = drive.trail.copied()
            trail.add(drive.data, drive.odometry)
            trail.write(shown, drive.data.time - self._delay_s)
            shown.time = drive.data.time
        update_poses(self._model, shown)

    def _finish(self, data: mujoco.MjData, image: Image) -> None:
        frame = frame_number(data)
        self._measured.append((image[1], frame, self._measure(image, frame)))

    def _unused(self) -> mujoco.MjData:
        return self._spare.pop() if self._spare else mujoco.MjData(self._model)
