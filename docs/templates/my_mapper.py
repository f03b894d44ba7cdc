"""A mapper of your own: voxels of signed distances (Curless and Levoy, SIGGRAPH 1996). Copy the file and change it."""

import numpy as np
from scipy.ndimage import map_coordinates

from anm_mj.frames import back_project
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.mapping.surface import SurfaceExtractor
from anm_mj.types import MapUpdate, Observation, OccupancyGrid, SurfacePoints
from anm_mj.utils.arrays import embed


class MyMapper:
    """A truncated signed distance field without a network, and the project's occupancy grid beside it."""

    truncation_m = 0.15  # A ray tells distances this far before and behind its end [m].
    at_first = 1e-6  # Number of rays and sum of distances [m] of a new voxel; their ratio says that nothing is near.

    def __init__(self) -> None:
        self.occupancy = DepthOccupancy(OccupancyConfig())  # Free, occupied and unknown voxels; it grows.
        self.crossings = SurfaceExtractor(self.occupancy, spacing_m=0.05)
        self.sums = np.zeros((2, 0, 0, 0), np.float32)  # Of each voxel [z, y, x]: number of rays, sum of distances [m].

    def integrate(self, observation: Observation) -> MapUpdate:
        """Fuse an observation, also one without any depth: the grid has to hold the robot's place."""
        image, before = (observation.depth_m, observation.intrinsics, observation.T_world_camera), self.occupancy.voxels
        self.occupancy.integrate(*image, observation.range_m)
        voxels, edge_m = self.occupancy.voxels, self.occupancy.config.voxel_m
        start = np.array([0, *(before.corner - voxels.corner)[::-1]])
        self.sums = self.sums if voxels is before else embed(self.sums, (2, *voxels.state.shape), start, self.at_first)
        end_m = back_project(*image)[:, None]
        ray = end_m - observation.T_world_camera[:3, 3]
        ray /= np.linalg.norm(ray, axis=2, keepdims=True)
        voxel = np.rint((end_m + ray * np.linspace(-self.truncation_m, self.truncation_m, 7)[:, None]) / edge_m)
        inside, cells = voxels.cells_of(voxel.reshape(-1, 3).astype(int))
        np.add.at(self.sums[0], cells, 1.0)
        np.add.at(self.sums[1], cells, ((end_m - voxel * edge_m) * ray).sum(axis=2).ravel()[inside])
        return MapUpdate(loss=np.nan, num_iterations=0, num_keyframes=0)

    def sdf(self, points_m: np.ndarray) -> np.ndarray:
        """Signed distance [m], positive in free space."""
        return np.clip(self._at(points_m, 1) / self._at(points_m, 0), -self.truncation_m, self.truncation_m)

    def uncertainty(self, points_m: np.ndarray) -> np.ndarray:
        """Variance of a mean, up to a constant factor."""
        return 1.0 / (1.0 + self._at(points_m, 0))

    def surface(self, centre_xy_m: np.ndarray, radius_m: float, max_height_m: float = np.inf) -> SurfacePoints:
        """Zero-crossings of the distance beside occupied voxels."""
        xyz_m, normal = self.crossings.extract(self.sdf, centre_xy_m, radius_m, max_height_m)
        return SurfacePoints(xyz_m, normal, self.uncertainty(xyz_m))

    def occupancy_grid(self, centre_xy_m: np.ndarray | None = None, radius_m: float = np.inf) -> OccupancyGrid:
        """The grid, which is of now everywhere."""
        return self.occupancy.grid

    def _at(self, points_m: np.ndarray, which: int) -> np.ndarray:
        cells = (points_m / self.occupancy.config.voxel_m - self.occupancy.voxels.corner).T[::-1]
        return map_coordinates(self.sums[which], cells, np.float32, order=1, cval=self.at_first)
