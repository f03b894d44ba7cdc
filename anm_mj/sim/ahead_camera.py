"""A camera in a thread of its own, which may begin images before they are asked for.

While the robot learns from one image and decides, the next ones are drawn, if somebody knows where they will be taken
from. An image that was begun is given out only where every pose that a camera reads is the same to the last bit, so
that guesses change how long an image takes and nothing else.
"""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import mujoco

from anm_mj.sim.camera import Camera, Image
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
        """The first image that was begun, if it is the one; else another, and all others are given up.

        See :meth:`Camera.render`.
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


def _is_same_view(a: mujoco.MjData, b: mujoco.MjData) -> bool:
    return all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in _READ)
