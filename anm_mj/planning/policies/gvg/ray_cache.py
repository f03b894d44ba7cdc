"""Rays through the pooled occupancy from places in the plane; a ray is cast again only when the cell it hit changed.

From each place rays in all azimuth sectors and a few elevations run to the first cell that is not free. Sectors are the
headings of the base: the rays of one run where the optical axis points while the base has that heading, so that a view
covers as many sectors on either side of its heading, however the camera is mounted. Rows of the cache hold the rays of
one place each; a place stands for the cell that contains it.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int, Int8, Int32, UInt8

from anm_mj import _native
from anm_mj.errors import PlanError
from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.policies.gvg.pooled_occupancy import PooledOccupancy
from anm_mj.planning.policies.gvg.views import NUM_AZIMUTHS

INSIDE = 0.95
"""The outermost rays lie this share of the way from the middle of the image to its edge."""
NEAREST_M = 0.25
"""Rays begin at this distance from the camera's axis [m]: the robot's own body is free."""
MAX_SAMPLES = 256
"""Of a ray; a byte holds the number of each."""
MIN_ROWS = 256
"""Rows allocated at first."""
MAX_ROWS = 32_768
"""The cache is cleared before it exceeds this many rows, which take 100 to 200 MB."""
NEVER_CAST = -3
"""Marks rays that were not cast yet; not the state of any cell."""


class Rays(NamedTuple):
    """The rays of ``n`` places, ordered by azimuth, then by elevation."""

    hit: Int32[np.ndarray, "n rays"]
    """First cell that is not free, as a flat index into the occupancy."""
    state: Int8[np.ndarray, "n rays"]
    """State of that cell."""
    sample: UInt8[np.ndarray, "n rays"]
    """Number of the sample that lies in it."""
    depth: UInt8[np.ndarray, "n rays"]
    """Where that cell is unknown, the number of unknown cells from there on."""


class RayCache:
    """Casts rays and remembers them as long as the cells they hit keep their state."""

    _azimuth_rad = 0.0
    """Where the camera looks beside the heading; checkpoints from before it was known do not say [rad]."""

    def __init__(self, occupancy: PooledOccupancy, *, camera: FieldOfView, range_m: float, num_elevations: int) -> None:
        """Start empty; rays of this length run from the height of the camera at elevations within its view."""
        self._occupancy = occupancy
        self._camera_height_m = camera.height_m
        self._azimuth_rad = camera.azimuth_rad
        self._range_m = range_m
        edges = np.linspace(*camera.slopes(INSIDE), num_elevations + 1)
        self._slope = (edges[:-1] + edges[1:]) / 2
        self.solid_angle = (math.tau / NUM_AZIMUTHS) * float(edges[1] - edges[0])
        """Area that each ray stands for at a distance of 1 m: the product of its steps in azimuth and slope."""
        self.distance_m: Float32[np.ndarray, " samples"] = np.zeros(0, np.float32)
        """Horizontal distance of each sample along a ray [m]."""
        self._layout = -1
        num_rays = NUM_AZIMUTHS * num_elevations
        self._offset = np.zeros((0, 0), np.int64)
        """Flat offset of each sample of each ray from the cell that the ray starts in."""
        self._row_of = np.zeros(0, np.int32)
        """Row of each cell of the camera's layer; -1 for none."""
        self._num_rows = 0
        self._start = np.zeros(0, np.int64)
        self._rays = Rays(*(np.zeros((0, num_rays), kind) for kind in (np.int32, np.int8, np.uint8, np.uint8)))

    def cast(self, places_xy_m: Float[np.ndarray, "n 2"]) -> Rays:
        """The rays of places as the occupancy is now.

        Raises:
            PlanError: the rays are too long for cells as small as these, or end before they begin.
        """
        self._follow_layout()
        places_m = np.insert(places_xy_m, 2, self._camera_height_m, axis=1)
        rows = self._allocate(self._occupancy.flat_index(places_m))
        # Casts those again whose cell has another state now.
        _native.cast_rays(self._occupancy.state, self._offset, self._start, rows, *self._rays)
        return Rays(*(array[rows] for array in self._rays))

    def cast_afresh(self, place_xy_m: Float[np.ndarray, "2"]) -> Rays:
        """The rays of one place, whatever is remembered of them; leaves what is remembered as it is."""
        self._follow_layout()
        start = self._occupancy.flat_index(np.array([[*place_xy_m, self._camera_height_m]]))
        rays = Rays(*(np.zeros_like(array, shape=(1, array.shape[1])) for array in self._rays))
        rays.state[:] = NEVER_CAST
        _native.cast_rays(self._occupancy.state, self._offset, start, np.zeros(1, np.int32), *rays)
        return rays

    def _allocate(self, start: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Rows of the cells that rays start in; new rows where there are none."""
        cell = start % len(self._row_of)
        new = np.unique(cell[self._row_of[cell] < 0])
        if self._num_rows + len(new) > MAX_ROWS:
            self._clear()
            new = np.unique(cell)
        self._row_of[new] = np.arange(self._num_rows, self._num_rows + len(new))
        self._num_rows += len(new)
        if self._num_rows > len(self._start):
            more = max(2 * self._num_rows, MIN_ROWS) - len(self._start)
            self._start = np.pad(self._start, (0, more))
            self._rays = Rays(*(np.pad(array, ((0, more), (0, 0))) for array in self._rays))
            self._rays.state[-more:] = NEVER_CAST
        rows = self._row_of[cell]
        self._start[rows] = start
        return rows

    def _follow_layout(self) -> None:
        """Clear the cache and recompute the offsets when the occupancy's array has grown."""
        if self._layout == self._occupancy.epoch:
            return
        self._layout = self._occupancy.epoch
        layers, rows, cols = self._occupancy.state.shape
        cell = self._occupancy.cell_m
        distance_m = np.arange(NEAREST_M, self._range_m, cell)
        if not len(distance_m):
            raise PlanError(
                f"The camera measures up to {self._range_m:g} m, but policy gvg expects surface from {NEAREST_M:g} m "
                "on; raise the camera's range (sensor.max_range_m) above that, or choose another --policy."
            )
        if len(distance_m) > MAX_SAMPLES:
            raise PlanError(
                f"A ray of {self._range_m:g} m through cells of {cell:g} m has {len(distance_m)} samples, and "
                f"{MAX_SAMPLES} are the most; lower policy.gain_range_m, or raise mapping.occupancy.voxel_m."
            )
        azimuth = np.arange(NUM_AZIMUTHS) * math.tau / NUM_AZIMUTHS + self._azimuth_rad
        # Offsets start at the centre of a cell: the place may lie anywhere in it.
        dx = np.rint(np.cos(azimuth)[:, None, None] * distance_m / cell)
        dy = np.rint(np.sin(azimuth)[:, None, None] * distance_m / cell)
        dz = np.rint(self._slope[None, :, None] * distance_m / cell)
        level = math.floor((self._camera_height_m - self._occupancy.origin_m[2]) / cell)
        # Steep rays end in the layer of the floor or in the highest layer.
        floor = max(math.floor(-self._occupancy.origin_m[2] / cell), 0)
        dz = np.clip(dz, floor - level, layers - 1 - level)
        self._offset = ((dz * rows + dy) * cols + dx).astype(np.int64).reshape(-1, len(distance_m))
        self.distance_m = distance_m.astype(np.float32)
        self._row_of = np.full(rows * cols, -1, np.int32)
        self._clear()

    def _clear(self) -> None:
        """Forget all rays; the rows are written over one by one."""
        self._row_of[:] = -1
        self._num_rows = 0
        self._rays.state[:] = NEVER_CAST
