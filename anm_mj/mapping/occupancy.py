"""Free, occupied and unknown space of a map: depth says what was observed, and field or depth what is solid there."""

import math

import numpy as np
from jaxtyping import Float

from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.field_occupancy import FieldOccupancy
from anm_mj.mapping.mapping_config import MappingConfig
from anm_mj.types import OccupancyGrid, SdfQuery


class Occupancy:
    """The occupancy grid of a map."""

    def __init__(self, config: MappingConfig) -> None:
        self.by_depth = DepthOccupancy(config.occupancy, config.moving)
        """What depth alone says, and how often each place was observed."""
        # One network without a grid has geometry that is too coarse to drive by.
        by_field = config.geometry == "field" and config.engine != "mlp"
        self._by_field = FieldOccupancy(self.by_depth) if by_field else None

    def forget_field(self) -> None:
        """Read everything again where the field decides: it has changed as a whole."""
        if self._by_field is not None:
            self._by_field = FieldOccupancy(self.by_depth)

    def grid(
        self, sdf_m: SdfQuery, centre_xy_m: Float[np.ndarray, "2"] | None = None, radius_m: float = math.inf
    ) -> OccupancyGrid:
        """The grid as of now; views of the arrays within. ``sdf_m`` is the field: signed distance at world points (N,
        3) [m], positive in free space; place and radius as of
        :meth:`anm_mj.mapping.neural_map.NeuralMap.occupancy_grid`.
        """
        if self._by_field is None:
            return self.by_depth.grid
        box = None if centre_xy_m is None else np.stack([centre_xy_m - radius_m, centre_xy_m + radius_m])
        return self._by_field.grid(sdf_m, box)
