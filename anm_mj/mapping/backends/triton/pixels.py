"""Replayed pixels in the memory of a device, which also makes the rays of them: no pixel comes from the host again.

A draw costs one copy of two integers per ray, and one of what it takes of the frame at hand. Torch's own kernels do it,
once for the batches of some training steps. A captured step reads none of this but the batch that was copied into its
buffer (:mod:`anm_mj.mapping.backends.triton.batch`), so keyframes may come and pixels go between its replays.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from jaxtyping import Float32, Int64, Shaped, UInt8
from torch import Tensor

from anm_mj.mapping.pixel_memory import DEPTH_UNIT_M, NO_DEPTH, PIXEL, require_room
from anm_mj.mapping.rays import CAMERA_NUMBERS, RayBatch

NUM_ROWS = 10
"""Rows of rays: three of origin, three of direction, three of colour, depth."""
_ROWS = {"origin_m": slice(0, 3), "direction": slice(3, 6), "rgb": slice(6, 9), "depth_m": 9}


class DeviceRays(RayBatch):
    """Rays in the memory of a device; whoever asks for them as arrays gets copies on the host."""

    rows: Float32[Tensor, "10 n"]
    """Origin, direction, colour and depth, as of :class:`anm_mj.mapping.rays.RayBatch`."""

    def __init__(self, rows: Float32[Tensor, "10 n"]) -> None:
        object.__setattr__(self, "rows", rows)

    def __len__(self) -> int:
        return self.rows.shape[1]

    def __getattr__(self, name: str) -> Float32[np.ndarray, "..."]:
        """What of a batch is not here but in the rows."""
        if name not in _ROWS:
            raise AttributeError(f"A batch on a device has no {name!r}; it has {sorted(_ROWS)} and 'rows'.")
        return self.rows[_ROWS[name]].t().cpu().numpy()


class DevicePixels:
    """Implements :class:`~anm_mj.mapping.pixel_memory.PixelMemory` on a device, whose memory is taken at once."""

    def __init__(self, count: int, device: torch.device) -> None:
        # As bytes, because no type of torch has nine.
        self._pixels = torch.empty(count, PIXEL.itemsize, dtype=torch.uint8, device=device)
        self._cameras = torch.zeros(0, CAMERA_NUMBERS, device=device)
        self._device = device

    def __len__(self) -> int:
        return len(self._pixels)

    def add_keyframe(self, start: int, pixels: Shaped[np.ndarray, " p"], camera: Float32[np.ndarray, "17"]) -> None:
        """Take in a keyframe; see the protocol."""
        packed = pixels.view(np.uint8).reshape(len(pixels), PIXEL.itemsize)
        self._pixels[start : start + len(pixels)].copy_(torch.from_numpy(packed))
        self._cameras = torch.cat((self._cameras, self._upload(camera[None])))

    def first(self, count: int) -> tuple[Shaped[np.ndarray, " p"], Float32[np.ndarray, "k 17"]]:
        """Copies of pixels and cameras; see the protocol."""
        return self._pixels[:count].cpu().numpy().reshape(-1).view(PIXEL), self._cameras.cpu().numpy()

    def replace(self, pixels: Shaped[np.ndarray, " p"], cameras: Float32[np.ndarray, "k 17"]) -> None:
        """Take over pixels and cameras; see the protocol."""
        require_room(pixels, cameras, len(self))
        packed = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), PIXEL.itemsize)
        self._pixels[: len(pixels)].copy_(torch.from_numpy(packed))
        self._cameras = self._upload(cameras.astype(np.float32))

    def move(self, old: int, new: int, count: int) -> None:
        """Move pixels; see the protocol."""
        # By way of a copy: on a device nothing says in which order a copy is done.
        self._pixels[new : new + count] = self._pixels[old : old + count].clone()

    def batches(
        self, place: Int64[np.ndarray, "k n"], keyframe: Int64[np.ndarray, "k n"], current: RayBatch
    ) -> Iterator[RayBatch]:
        """World rays of batches; see the protocol."""
        (num_batches, num_stored), num_current = place.shape, len(current) // len(place)
        drawn = self._upload(np.stack((place.ravel(), keyframe.ravel())))
        fresh = (current.origin_m.T, current.direction.T, current.rgb.T, current.depth_m[None])
        rows = torch.empty(num_batches, NUM_ROWS, num_stored + num_current, device=self._device)
        for start, rays in ((0, self._rays(*drawn)), (num_stored, self._upload(np.concatenate(fresh)))):
            by_batch = rays.view(NUM_ROWS, num_batches, -1).transpose(0, 1)
            rows[:, :, start : start + by_batch.shape[2]] = by_batch
        yield from (DeviceRays(batch) for batch in rows)

    def _rays(self, place: Int64[Tensor, " n"], keyframe: Int64[Tensor, " n"]) -> Float32[Tensor, "10 n"]:
        """Rows of stored pixels, as :func:`anm_mj.mapping.rays.rays_of_pixels` makes them."""
        # The bytes of pixel_memory.PIXEL: index, colour, depth.
        packed = self._pixels[place]
        index = _integers(packed[:, :4], torch.int32) & 0xFFFFFFFF
        units = _integers(packed[:, 7:], torch.int16) & 0xFFFF
        width, fx, fy, cx, cy, *pose = self._cameras[keyframe].t()
        columns = width.to(torch.int64)
        row = torch.div(index, columns, rounding_mode="floor")
        # In double precision, as on the host.
        column = (index - row * columns).to(torch.float64)
        right = ((column + 0.5 - cx) / fx).to(torch.float32)
        down = ((row.to(torch.float64) + 0.5 - cy) / fy).to(torch.float32)
        direction = [pose[k] * right + pose[k + 1] * down + pose[k + 2] for k in (0, 4, 8)]
        rgb = packed[:, 4:7].t() / 255.0
        depth = torch.where(units == NO_DEPTH, torch.nan, units * DEPTH_UNIT_M)
        return torch.stack((*pose[3::4], *direction, *rgb, depth))

    def _upload(self, array: Shaped[np.ndarray, "..."]) -> Shaped[Tensor, "..."]:
        return torch.from_numpy(array).to(self._device)


def _integers(data: UInt8[Tensor, "n bytes"], dtype: torch.dtype) -> Int64[Tensor, " n"]:
    """Bytes as signed integers of a type that has as many."""
    # One row of a larger array counts as contiguous, and yet cannot be viewed so: only a copy can.
    return data.clone(memory_format=torch.contiguous_format).view(dtype)[:, 0].to(torch.int64)
