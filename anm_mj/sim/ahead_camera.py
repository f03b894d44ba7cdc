"""A camera in a thread of its own, which may begin an image before it is asked for.

While the map learns from one image, the next one is drawn, if somebody knows where it will be taken from. An image that
was begun is given out only where every pose that a camera reads is the same to the last bit, so that guesses change
how long an image takes and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float32, UInt8

from anm_mj.sim.camera import Camera
from anm_mj.utils.cores import lent_core

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
    image: Future[tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]]


class AheadCamera(Camera):
    """Renders with another camera, in one thread that does nothing else."""

    def __init__(self, make: Callable[[], Camera]) -> None:
        """Make the camera in its thread: a GL context belongs to one.

        Args:
            make: makes the camera.

        Raises:
            RenderError: of ``make``.
        """
        self._thread = ThreadPoolExecutor(1, "camera")
        try:
            self._camera = self._thread.submit(make).result()
        except BaseException:
            self._thread.shutdown()
            raise
        self.kind = self._camera.kind
        self._model = self._camera._model
        self._camera_id = self._camera._camera_id
        self._intrinsics = self._camera.intrinsics
        self._begun: _Begun | None = None
        self._closed = False

    def begin(self, data: mujoco.MjData) -> None:
        """Begin an image, and return at once.

        Args:
            data: with all poses up to date; it must not change before the next :meth:`render`.
        """
        if self._begun is None and not self._closed:
            self._begun = _Begun(data, self._thread.submit(self._render_beside, data))

    def render(self, data: mujoco.MjData) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
        """The image that was begun, if it is the one; else another. See :meth:`Camera.render`."""
        begun, self._begun = self._begun, None
        if begun is not None:
            failed = begun.image.exception()
            if failed is None and _is_same_view(begun.data, data):
                return begun.image.result()
        if self._closed:
            return self._camera.render(data)
        return self._thread.submit(self._camera.render, data).result()

    def close(self) -> None:
        """Free the camera; may be called again."""
        if not self._closed:
            self._closed = True
            self._thread.submit(self._camera.close).result()
            self._thread.shutdown()

    def _render_beside(self, data: mujoco.MjData) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
        with lent_core():
            return self._camera.render(data)


def _is_same_view(a: mujoco.MjData, b: mujoco.MjData) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in _READ)
