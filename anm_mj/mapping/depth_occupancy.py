"""Free, occupied and unknown space, fused from depth; it stands beside the neural field, which knows no "unknown".

Carving is conservative: a voxel becomes free only if the smallest depth in its whole pixel footprint lies behind it, so
a table leg of a few pixels keeps its voxels, and so do the voxels it might hide. A hit weighs as much as several
misses. Voxel centres lie at multiples of the voxel edge, so that a floor at z = 0 fills one layer and not, at random,
two.
"""

import math
from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32, Int64, UInt16
from scipy import ndimage

from anm_mj import _native
from anm_mj.errors import MapError
from anm_mj.frames import pixel_directions
from anm_mj.mapping.carried_voxels import carry
from anm_mj.mapping.depth_noise import NoiseMean
from anm_mj.mapping.mapping_config import MovingConfig, OccupancyConfig
from anm_mj.mapping.moved_pixels import MovedVoxels, depth_doubt
from anm_mj.mapping.occupancy_kernels import (
    BLOCK,
    FARTHEST_CELL,
    CameraView,
    DepthFrame,
    OccupancyKernels,
    VoxelArrays,
    check_arrays,
    unseen_voxels,
)
from anm_mj.mapping.stray_pixels import Strays, are_single_outside, is_straying
from anm_mj.sensing.missing_floor import SQUARE_M, MissingFloor
from anm_mj.sensing.pixel_state import free_space_depth
from anm_mj.types import UNKNOWN, Intrinsics, Observation, OccupancyGrid, thinning_stride
from anm_mj.utils.file_limits import limit

MovedPoses = tuple[Float[np.ndarray, "m 4 4"], Float[np.ndarray, "m 4 4"]]
"""Poses of keyframes before and after a correction, camera to world."""
_LAYER_BLOCKS, _PLANE_BLOCKS = 1, 4
"""Blocks that the grid grows by at least, in height and in the plane."""
_HITS_THAT_FILL, _MISSES_THAT_EMPTY = 3, 5
"""So many frames that contradict it change the state of a voxel of a prior run."""
MAX_VOXELS = limit("ANM_MJ_MAX_VOXELS", 130_000_000)
"""Most voxels of a grid; each takes eight bytes."""
HIT_FOCAL_PX = 64.0
"""Focal length at which every pixel marks a hit [px]; sharper images are thinned to about as many, other pixels being
taken from frame to frame."""


class DepthOccupancy:
    """Voxels ``[layer, row, col]`` = ``[z, y, x]`` with 8-bit log-odds; grows by blocks and keeps what it holds."""

    REBUILT = ("_kernels", "_rays")

    def __init__(self, config: OccupancyConfig, moving: MovingConfig | None = None) -> None:
        self.config = config
        self._moved = MovedVoxels(moving or MovingConfig(), config)
        self._kernels = OccupancyKernels(config)
        self.voxels = unseen_voxels((0, 0, 0), np.zeros(3, np.int64))
        """``log_odds`` of being occupied in tenths, 0 where never observed. ``num_hits``: pixels of all frames that
        fell into each voxel, up to 65535, images thinned to 64 px of focal length; near, frontal and repeated views all
        add to it: it is the sampling density of the surface. ``block_stamp``: number of the last frame (from 1) that
        had a hit in a block; 0 where none had. ``corner`` is a multiple of ``BLOCK``."""
        self.noise = NoiseMean()
        """How noisy the images are."""
        self.strays = Strays()
        """Whether single pixels of them lie where nothing is."""
        self._missing_floor = MissingFloor(max(SQUARE_M, config.voxel_m))
        self._num_frames = 0
        self._rays: tuple[Intrinsics, Float32[np.ndarray, "h w 3"]] | None = None

    @property
    def grid(self) -> OccupancyGrid:
        """The grid as it stands; its arrays are views, its version is the number of frames.

        A voxel counts as changed when its state did, or when ``seen_range_m`` fell to another whole number of
        ``SEEN_RANGE_STEP_M``.
        """
        voxels, edge = self.voxels, self.config.voxel_m
        origin = (voxels.corner - 0.5) * edge
        return OccupancyGrid(voxels.state, voxels.seen_range_m, origin, edge, self._num_frames, voxels.column_version)

    def surface_volume_m3(self) -> float:
        """Volume of the blocks that ever had a hit in them [m3]: a measure of the scene."""
        return float(np.count_nonzero(self.voxels.block_stamp) * (BLOCK * self.config.voxel_m) ** 3)

    def blocks_with_hits(self) -> tuple[Int64[np.ndarray, "n 3"], Int32[np.ndarray, " n"]]:
        """Blocks that ever had a hit in them, by x, y, z in blocks of the world, and the frame of the last one."""
        layer, row, col = np.nonzero(self.voxels.block_stamp)
        blocks = np.stack((col, row, layer), axis=1) + self.voxels.corner // BLOCK
        return blocks, self.voxels.block_stamp[layer, row, col]

    def integrate(
        self,
        depth_m: Float32[np.ndarray, "h w"],
        intrinsics: Intrinsics,
        T_world_camera: Float[np.ndarray, "4 4"],
        range_m: float = math.inf,
        moved_m: Float32[np.ndarray, "h w"] | None = None,
        *,
        takes_moved: bool = True,
    ) -> None:
        """Fuse one depth image: carve what was looked through, then mark what was hit. Raises MapError if the grid
        would have more than ``MAX_VOXELS``, or voxels beyond ``FARTHEST_CELL``.

        ``depth_m`` is planar [m]: +inf where the sensor looked farther than its range, ``range_m``, and NaN where it
        measured nothing. ``moved_m`` is that of the pixels that show something moved, NaN elsewhere; ``depth_m`` has
        none there. ``takes_moved``: what moved and stays becomes surface, by the frames that show it.
        """
        self._num_frames += 1
        self.noise.add(depth_m)
        view = self._view(depth_m, intrinsics, T_world_camera)
        stride = thinning_stride(intrinsics.fx, HIT_FOCAL_PX)
        phase = self._num_frames % stride, self._num_frames // stride % stride
        voxels, hit_depth = self._kernels.hits(view, phase, stride)
        self.strays.add(is_straying(self.voxels, self.config, voxels, hit_depth))
        if self.strays.are_known:
            # One that lies outside would make the grid grow for nothing.
            apart = hit_depth * np.float32(stride / (intrinsics.fx * self.config.voxel_m))
            kept = ~are_single_outside(self.voxels, voxels, apart)
            voxels, hit_depth = voxels[kept], hit_depth[kept]
        low, high = box = self._view_box(view, 0.0)
        if len(voxels):
            # Axis by axis: a reduction over many rows of three takes several times as long.
            low = np.minimum(low, [axis.min() for axis in voxels.T])
            high = np.maximum(high, [axis.max() for axis in voxels.T])
        if moved_m is not None:
            depth_m = np.fmin(depth_m, moved_m)  # Of the two, one is NaN.
            view = view._replace(depth_m=depth_m)
        if self.config.no_depth_is_free and not np.isfinite(depth_m).all():
            view = view._replace(depth_m=free_space_depth(depth_m, range_m))
            box = self._view_box(view, self.config.carve_range_m)
            # Space that was looked through is known, however far away the next surface lies. The sky above is not kept.
            low[:2], high[:2] = np.minimum(low, box[0])[:2], np.maximum(high, box[1])[:2]
        self._grow(low, high)
        # After that: where a pose is absurd, it has said so.
        missing_xy_m = self._missing_floor.look(depth_m, intrinsics, T_world_camera, range_m)
        no_floor = self._missing_floor.voxels(missing_xy_m, self.config.voxel_m)
        if len(no_floor):
            self._grow(no_floor.min(axis=0), no_floor.max(axis=0))
        self._moved.expire(self.voxels, self._num_frames)
        heavy = self._moved.heavy(self.voxels, self._num_frames)
        if takes_moved and moved_m is not None:
            places, _ = self._kernels.hits(view._replace(depth_m=moved_m), phase, stride)
            self._moved.take(self.voxels, places, self._num_frames)
        low, high = box
        corner = self.voxels.corner
        low, high = np.maximum(low, corner), np.minimum(high, corner + self.voxels.state.shape[::-1] - 1)
        self._kernels.carve(self.voxels, view, low, high, self._num_frames, heavy)
        if heavy.size:
            self._kernels.free_left(self.voxels, heavy, self._moved.heights, self._num_frames)
            self._moved.free_left(self.voxels, self._num_frames)
        self._kernels.mark(self.voxels, voxels, hit_depth, self._num_frames)
        if len(no_floor):
            # No ray went through them; a hit fills them again, as if one had.
            self.voxels.free(no_floor, -self.config.miss, self._num_frames)
        self._moved.look(self.voxels)

    def hold_moved(self, discs: Float[np.ndarray, "n 3"]) -> None:
        """See :class:`anm_mj.protocols.FindsMoved`."""
        self._moved.hold(self.voxels, discs, self._num_frames)

    def release_moved(self) -> bool:
        """See :class:`anm_mj.protocols.FindsMoved`."""
        return self._moved.release(self.voxels, self._num_frames)

    def doubt_moved(self) -> bool:
        """See :class:`anm_mj.protocols.FindsMoved`."""
        return self._moved.doubt(self.voxels, self._num_frames)

    def settle_moved(self) -> bool:
        """Take what was doubted and not seen since for surface again, and nothing that moved for an obstacle; whether
        anything changed, which readers of the last frame do not notice.
        """
        return self._moved.settle(self.voxels, self._num_frames)

    def is_pretended(self, indices: Int64[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """Whether voxels, by index into the raveled grid, are held (occupied for now) or doubted (free for now)."""
        return self._moved.is_pretended(self.voxels, indices)

    def find_moved(self, observation: Observation) -> Bool[np.ndarray, "h w"] | None:
        """The pixels of a frame that show something that was not there before; None for none."""
        if not self.voxels.state.size:
            return None
        view = self._view(observation.depth_m, observation.intrinsics, observation.T_world_camera)
        doubt = depth_doubt(self.noise.value, observation)
        moved = self._kernels.moved(self.voxels, view, doubt, self._moved.config.free_looks)
        return moved if moved.any() else None

    def rebuild(self, frames: Iterable[DepthFrame], moved: MovedPoses | None = None) -> None:
        """Forget all voxels and fuse these depth images: what was carved cannot be moved.

        ``moved`` are poses of keyframes before and after a correction: what the images do not show stays as it was, and
        moves with the nearest keyframe. The count of frames goes on; what is known of the sensor's noise stays.
        """
        noise, strays = self.noise.array(), self.strays.array()
        self.settle_moved()
        before = self.voxels
        self.voxels = unseen_voxels(before.state.shape, before.corner)
        self._missing_floor = MissingFloor(self._missing_floor.square_m)
        for frame in frames:
            self.integrate(*frame, takes_moved=False)
        if moved is not None:
            carry(before, self.voxels, *moved, self.config.voxel_m, self._num_frames)
        self.noise.set_array(noise)
        self.strays.set_array(strays)
        self.voxels = self.voxels._replace(column_version=np.full_like(self.voxels.column_version, self._num_frames))

    def state_at(self, points_m: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """State of the voxels that hold world points [m]; UNKNOWN outside the grid."""
        inside, cells = self.voxels.cells_of(np.rint(points_m / self.config.voxel_m).astype(np.int64))
        out = np.full(len(points_m), UNKNOWN, np.int8)
        out[inside] = self.voxels.state[cells]
        return out

    def observation_count(
        self, depth_m: Float32[np.ndarray, "h w"], intrinsics: Intrinsics, T_world_camera: Float[np.ndarray, "4 4"]
    ) -> UInt16[np.ndarray, "h w"]:
        """``num_hits`` of the voxel that each pixel of a depth image shows; 0 where it shows none of the grid."""
        return self._kernels.counts(self.voxels, self._view(depth_m, intrinsics, T_world_camera))

    def replay_weight(self, observation: Observation, exponent: float) -> Float32[np.ndarray, "h w"] | None:
        """Weights by which an image's pixels are drawn for replay: its observation counts to the power -``exponent``.

        An image shows a near floor with thousands of pixels and a chair's leg with ten, once. Uniform draws (None) keep
        improving the floor while surface with few observations stays unlearnt.
        """
        if exponent == 0.0:
            return None
        count = self.observation_count(observation.depth_m, observation.intrinsics, observation.T_world_camera)
        known = count > 0
        # Pixels that show no surface get the weight of a typical one.
        usual = np.median(count[known]) if known.any() else 1.0
        return np.where(known, count, usual).astype(np.float32) ** np.float32(-exponent)

    def near_occupied(self, points_m: Float[np.ndarray, "n 3"], reach_m: float) -> Bool[np.ndarray, " n"]:
        """True for points with an occupied voxel within ``reach_m`` (less than half a voxel edge) along every axis."""
        near = np.empty(len(points_m), np.uint8)
        points = np.ascontiguousarray(points_m, np.float64)
        _native.near_occupied(self.voxels.state, self.voxels.corner, self.config.voxel_m, points, reach_m, near)
        return near.view(bool)

    def arrays(self) -> dict[str, np.ndarray]:
        """What a file holds, by name; views, as copies would take as much memory as the grid."""
        arrays = self.voxels._asdict()
        # A reader of the file reads everything anyway.
        del arrays["column_version"]
        learnt = {"depth_noise": self.noise.array(), "strays": self.strays.array()}
        return {**arrays, "num_frames": np.array(self._num_frames), **learnt}

    def set_arrays(self, arrays: dict[str, np.ndarray]) -> None:
        """Take over what :meth:`arrays` gave. Raises ValueError if it was not given so."""
        check_arrays(arrays)
        self._num_frames = int(arrays["num_frames"])
        self.noise.set_array(arrays["depth_noise"])
        self.strays.set_array(arrays.get("strays", np.zeros(2)))
        self.voxels = VoxelArrays(
            log_odds=arrays["log_odds"].astype(np.int8),
            state=arrays["state"].astype(np.int8),
            seen_range_m=arrays["seen_range_m"].astype(np.float32),
            num_hits=np.minimum(arrays["num_hits"], np.iinfo(np.uint16).max).astype(np.uint16),
            block_stamp=arrays["block_stamp"].astype(np.int32),
            column_version=np.full(arrays["block_stamp"].shape[1:], self._num_frames, np.int32),
            corner=arrays["corner"].astype(np.int64),
        )

    def soften(self) -> None:
        """Let a few frames change what earlier ones have found; the states stay as they are until then.

        Within a run, many frames that agree make a voxel sure. Between two runs, furniture moves.
        """
        free = (1 - _HITS_THAT_FILL) * self.config.hit
        occupied = _MISSES_THAT_EMPTY * self.config.miss
        log_odds = np.clip(self.voxels.log_odds, max(free, -self.config.limit), min(occupied, self.config.limit))
        self.voxels = self.voxels._replace(log_odds=log_odds)

    def _view(
        self, depth_m: Float32[np.ndarray, "h w"], intrinsics: Intrinsics, T_world_camera: Float[np.ndarray, "4 4"]
    ) -> CameraView:
        if self._rays is None or self._rays[0] != intrinsics:
            self._rays = (intrinsics, pixel_directions(intrinsics).astype(np.float32))
        rotation, position = T_world_camera[:3, :3].astype(np.float32), T_world_camera[:3, 3].astype(np.float32)
        return CameraView(depth_m, self._rays[1], intrinsics, rotation, position)

    def _view_box(self, view: CameraView, missing_m: float) -> tuple[Int64[np.ndarray, "3"], Int64[np.ndarray, "3"]]:
        """Lowest and highest voxel of the box about the camera and all ray ends within the carving range.

        Rays that looked farther than the sensor's range end at ``missing_m``.
        """
        # Every fourth pixel tells the box to within a voxel or two, and what sticks out is carved by another frame.
        reach = view.depth_m[::4, ::4]
        if not np.isfinite(reach).all():
            reach = np.nan_to_num(reach, nan=0.0, posinf=missing_m)
        reach = reach.clip(0.0, self.config.carve_range_m)
        if self.strays.are_known:
            # A pixel of nothing would make the grid grow for nothing.
            reach = ndimage.median_filter(reach, size=3, mode="nearest")
        ends = (view.rays[::4, ::4] * reach[:, :, None]).reshape(-1, 3) @ view.rotation.T
        low = np.minimum([axis.min() for axis in ends.T], np.float32(0.0)) + view.position
        high = np.maximum([axis.max() for axis in ends.T], np.float32(0.0)) + view.position
        edge = self.config.voxel_m
        return np.floor(low / edge).astype(np.int64), np.ceil(high / edge).astype(np.int64)

    def _grow(self, low: Int64[np.ndarray, "3"], high: Int64[np.ndarray, "3"]) -> None:
        """Make room for voxels ``low`` to ``high`` (x, y, z, both included). Raises MapError beyond ``MAX_VOXELS`` or
        ``FARTHEST_CELL``.
        """
        old = self.voxels
        shape = np.array(old.state.shape[::-1])
        if shape.all() and (low >= old.corner).all() and (high < old.corner + shape).all():
            return
        self._require_size(low, high)
        step = BLOCK * np.array([_PLANE_BLOCKS, _PLANE_BLOCKS, _LAYER_BLOCKS])
        new_low = np.floor_divide(low, step) * step
        new_high = (np.floor_divide(high, step) + 1) * step
        if shape.all():
            new_low = np.minimum(new_low, old.corner)
            new_high = np.maximum(new_high, old.corner + shape)
        self.voxels = unseen_voxels(tuple((new_high - new_low)[::-1].tolist()), new_low)
        if shape.all():
            self.voxels.take_over(old)

    def _require_size(self, low: Int64[np.ndarray, "3"], high: Int64[np.ndarray, "3"]) -> None:
        """Raises MapError where a grid with voxels ``low`` to ``high`` would be too large, or reach too far out."""
        # In floating point: what lies far beyond all bounds overflows whole numbers.
        first, last = low.astype(np.float64), high + 1.0
        if self.voxels.state.size:
            first = np.minimum(first, self.voxels.corner)
            last = np.maximum(last, self.voxels.corner + np.array(self.voxels.state.shape[::-1]))
        cells, farthest = last - first, max(np.abs(first).max(), np.abs(last).max())
        if cells.prod() <= MAX_VOXELS:
            if farthest <= FARTHEST_CELL:
                return
            raise MapError(
                f"Frame {self._num_frames} lets the map reach {farthest * self.config.voxel_m:.4g} m from the origin, "
                f"but voxels of {self.config.voxel_m:g} m are told apart up to "
                f"{FARTHEST_CELL * self.config.voxel_m:.4g} m: move the origin of the poses near to the scene."
            )
        size = " x ".join(f"{edge_m:.4g}" for edge_m in cells * self.config.voxel_m)
        raise MapError(
            f"Frame {self._num_frames} lets the map extend over {size} m, which is {cells.prod():.3g} voxels of "
            f"{self.config.voxel_m:g} m, but they end at {MAX_VOXELS}: check the poses, the camera and the unit of "
            "depth, or set ANM_MJ_MAX_VOXELS if it should be so large."
        )
