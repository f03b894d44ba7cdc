"""A finished run that another one continues: its map, its keyframes, and what it explored."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from anm_mj.config import RunConfig
from anm_mj.errors import MapError, RunFolderError
from anm_mj.io.explored_file import Explored, read_explored
from anm_mj.io.read_run import Run, read_run
from anm_mj.mapping.keyframes import Keyframes
from anm_mj.mapping.map_file import SavedMap, read_map
from anm_mj.types import ExploredState, OccupancyGrid

if TYPE_CHECKING:
    from anm_mj.mapping.neural_map import NeuralMap

_logger = logging.getLogger(__name__)

OWN_KIND = "mlp"
"""The engine whose maps no other engine can go on with."""
_BESIDE_MAP_M = 1.0
"""A robot is no farther outside of its map than this [m]."""


@dataclass(frozen=True)
class PriorRun:
    """What another run goes on from."""

    run: Run
    explored: Explored
    saved: SavedMap
    keyframes: Keyframes

    @classmethod
    def read(cls, path: Path) -> PriorRun:
        """Read a finished run. Raises RunFolderError if the folder is no run, or lacks what another run needs; the
        sentence says what, and MapError if its map or its keyframes cannot be read.
        """
        run = read_run(path)
        if not run.folder.map.is_file():
            raise RunFolderError(
                f"{path} has no {run.folder.map.name}: the run was killed before its end; anm-mj explore --resume "
                f"{path} ends it."
            )
        explored = read_explored(run.folder.explored)
        return cls(run, explored, read_map(run.folder.map), Keyframes.of(explored.replay))

    def config(self, config: RunConfig) -> RunConfig:
        """The configuration of the run that goes on, with the shape of the map as the prior run has it. Raises MapError
        if the map is of another kind than the run's.
        """
        before, now = self.saved.config, config.mapping
        if (before.engine == OWN_KIND) != (now.engine == OWN_KIND):
            kinds = ("the map of one network", "a map with a hash grid")
            has, needs = kinds if before.engine == OWN_KIND else kinds[::-1]
            raise MapError(
                f"The run in {self.run.folder.path} has {has}, but policy {config.policy} works on {needs}; continue "
                f"with the policy of that run, {self.explored.prior.policy}, or start without --continue."
            )
        occupancy = replace(now.occupancy, voxel_m=before.occupancy.voxel_m)
        if (before.field, occupancy) != (now.field, now.occupancy):
            _logger.info("Field and voxels of the map keep the shape that they have in %s.", self.run.folder.path)
        mapping = replace(now, field=before.field, occupancy=occupancy)
        return replace(config, mapping=mapping, continue_from=self.folder)

    def compare_scene(self, scene: str, scene_hash: str) -> None:
        """Warn where the run was in another scene, not in an older state of this one."""
        before = str(self.run.manifest.get("scene", ""))
        same = self.run.manifest.get("scene_hash") == scene_hash or Path(before).name == Path(scene).name
        if before and not same:
            _logger.warning(
                "%s was a run in the scene %s, and this one is in %s: its map counts as it stands, which is right only "
                "where both have the same walls in the same place.",
                self.run.folder.path,
                before,
                scene,
            )

    def begin(self, mapper: NeuralMap) -> None:
        """Let a new map begin with the prior run. Raises MapError if the files do not fit each other."""
        try:
            mapper.continue_from(self.saved, self.keyframes)
        except (KeyError, ValueError, TypeError, IndexError) as err:
            raise MapError(f"The map in {self.run.folder.path} is damaged ({err}); explore again.") from err
        self._require_places(mapper.occupancy_grid())

    def _require_places(self, grid: OccupancyGrid) -> None:
        """Raises MapError where a robot was far from all that its map knows, which is then the map of another run."""
        low, size = grid.origin_m[:2], np.array(grid.state.shape[:0:-1]) * grid.resolution_m
        for name in ("poses", "collisions"):
            places = getattr(self.explored.prior, name)[:, :2]
            away = ((places < low - _BESIDE_MAP_M) | (places > low + size + _BESIDE_MAP_M)).any(axis=1)
            if away.any():
                x, y = places[int(np.argmax(away))]
                raise MapError(
                    f"{self.run.folder.explored} names the place ({x:.4g}, {y:.4g}) m, which lies outside of the map "
                    "beside it: they are of two runs; copy the run again."
                )

    def found(self, policy: str) -> ExploredState:
        """What the run found out beside its map; its policy's memory only for the same policy."""
        prior = self.explored.prior
        return prior if prior.policy == policy else replace(prior, memory={})

    @property
    def folder(self) -> str:
        """Where the run lies, without links."""
        return str(self.run.folder.path)

    @property
    def provenance(self) -> dict[str, Any]:
        """What the manifest of the run that goes on says of it."""
        return {
            "run": self.folder,
            "scene_hash": self.run.manifest.get("scene_hash"),
            "frames": len(self.explored.prior.poses),
        }
