"""Reads MuJoCo worlds (MJCF): the camera sees what MuJoCo draws, the robot meets what collides.

The world is compiled by MuJoCo, so that includes, defaults, frames and every format of mesh and texture count as they
do there. Robots, actuators, cameras, lights and markers are left out. A mesh collides with its own triangles instead of
its convex hull, which would fill the rooms of a building in one piece.
"""

from collections.abc import Collection, Sequence
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Bool

from anm_mj.errors import SceneError
from anm_mj.geometry.triangles import FARTHEST_M
from anm_mj.scene.importing.readers.import_limits import MAX_TRIANGLES
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.mjcf.bodies import free_bodies, joints_of, movable_of, part_names, robot_bodies
from anm_mj.scene.importing.readers.mjcf.compile_world import compiled, initial_state, up_axis
from anm_mj.scene.importing.readers.mjcf.cut_ground import (
    Placement,
    cut_height_field,
    cut_plane,
    cut_slab,
    ground_box,
    is_wide_slab,
    surrounds,
)
from anm_mj.scene.importing.readers.mjcf.geom_textures import Looks, geom_rgba
from anm_mj.scene.importing.readers.mjcf.geom_triangles import Shape, geom_shape, num_triangles
from anm_mj.scene.importing.readers.parsed_scene import ParsedScene
from anm_mj.scene.submesh import Submesh, transformed

DRAWN_GROUPS = (0, 1, 2)

_AXES = {"x": [1, 2, 0], "y": [2, 0, 1], "z": [0, 1, 2]}
_UPRIGHT = 0.1
"""Sine of the angle by which a wall may lean."""

_ROBOT = "Left out, because actuators drive them: the robots {names}."
_OTHERS = "Left out: {names}."
_NOTHING_SOLID = "Nothing in the world collides: the robot meets whatever is drawn."
_GROUND_SOLID = "Nothing in the world collides but the ground: the robot meets whatever is drawn."
_FREE = "Stand still where they are: the free bodies {names}; --movable lets the robot push them."
_NOT_SOLID = "Stand still where they are, because nothing of them collides: the free bodies {names}."


def read_mjcf(
    src: Path,
    model_paths: Sequence[Path],
    report: ImportReport,
    *,
    settle: bool = False,
    movable: bool = False,
    groups: Collection[int] | None = None,
) -> ParsedScene:
    """The world in an MJCF file, at its first key frame or as it is written.

    Files that it names may lie in its own folder, those above, and ``model_paths``; the report gets what is left out.
    The other arguments are those of :func:`anm_mj.scene.importing.import_scene.import_scene`. Raises SceneError if the
    file cannot be compiled, or nothing in it is drawn.
    """
    groups = DRAWN_GROUPS if groups is None else groups
    model = compiled(src, model_paths)
    data = initial_state(model, settle)
    reader = _Reader(model, data, groups)
    _report_left_out(model, reader.names, reader.robots, report)
    free = [body for body in free_bodies(model) if not reader.robots[body]]
    movables = [movable_of(model, data, body, reader.names[body]) for body in free if movable]
    for body in free if not movable else ():
        report.add(_FREE, reader.names[body])
    for own in movables:
        if not own.solids:
            report.add(_NOT_SOLID, own.part)
    drawn, solid = reader.read()
    if not drawn:
        shown = ", ".join(map(str, sorted(groups)))
        raise SceneError(f"{src} holds nothing that is drawn (no geom in the groups {shown}): --groups names others.")
    if not reader.solid_walls.any():
        report.add(_GROUND_SOLID if solid else _NOTHING_SOLID, "")
        solid = None
    elif (reader.drawn == reader.solid).all():
        solid = None
    return ParsedScene(
        drawn,
        f"MuJoCo world {src.name}",
        up=up_axis(model),
        up_certainty=float("inf"),
        scale=1.0,
        obstacles=solid,
        joints=joints_of(model, data, reader.names),
        movables=tuple(own for own in movables if own.solids),
    )


class _Reader:
    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, groups: Collection[int]) -> None:
        self._model, self._data = model, data
        self._looks = Looks(model)
        self.names = part_names(model)
        self.robots = robot_bodies(model, data)
        kept = ~self.robots[model.geom_bodyid]
        opacity = np.array([geom_rgba(model, geom)[3] for geom in range(model.ngeom)])
        self.drawn: Bool[np.ndarray, " g"] = kept & np.isin(model.geom_group, list(groups)) & (opacity > 0.0)
        self.solid: Bool[np.ndarray, " g"] = kept & ((model.geom_contype != 0) | (model.geom_conaffinity != 0))
        kinds = mujoco.mjtGeom
        # Axes of the world with the one that points up as the last.
        self._axes = _AXES[up_axis(model)]
        # Planes that stand upright, and end, are walls.
        normal_up = data.geom_xmat.reshape(-1, 3, 3)[:, self._axes[2], 2]
        is_wall = (model.geom_size[:, :2] > 0.0).all(axis=1) & (np.abs(normal_up) < _UPRIGHT)
        self._is_plane: Bool[np.ndarray, " g"] = (model.geom_type == kinds.mjGEOM_PLANE) & ~is_wall
        self._is_field = model.geom_type == kinds.mjGEOM_HFIELD
        is_box = model.geom_type == kinds.mjGEOM_BOX
        turned = [self._placement(geom)[0][self._axes] for geom in range(model.ngeom)]
        wide = [is_wide_slab(half, rotation) for half, rotation in zip(model.geom_size, turned, strict=True)]
        self._is_slab: Bool[np.ndarray, " g"] = is_box & np.array(wide, dtype=bool)
        self.solid_walls = self.solid & ~self._is_plane & ~self._is_field & ~self._is_slab
        """What collides and is no ground."""

    def read(self) -> tuple[list[Submesh], list[Submesh]]:
        """What is drawn and what collides, in the world [m]."""
        used = self.drawn | self.solid
        self._check_number(np.flatnonzero(used).tolist())
        shapes: dict[int, Shape] = {}
        for geom in np.flatnonzero(used & ~self._is_plane).tolist():
            shape = geom_shape(self._model, geom)
            if shape is not None and len(shape.faces):
                self._check_extent(geom, shape)
                shapes[geom] = shape
        self._add_grounds(shapes, np.flatnonzero(used & (self._is_plane | self._is_field)).tolist())
        drawn, solid = [], []
        for geom in sorted(shapes):
            name, part = self._names(geom)
            place = self._placement(geom)
            if self.drawn[geom]:
                for submesh in self._looks.submeshes(geom, shapes[geom], name, part):
                    drawn.append(transformed(submesh, *place))
            if self.solid[geom]:
                plain = Submesh(name, shapes[geom].vertices_m, shapes[geom].faces, part=part)
                solid.append(transformed(plain, *place))
        return drawn, solid

    def _add_grounds(self, shapes: dict[int, Shape], grounds: list[int]) -> None:
        fields = {geom: shapes.pop(geom) for geom in grounds if geom in shapes}
        slabs = {geom: shapes.pop(geom) for geom in list(shapes) if self._is_slab[geom]}
        standing = {geom: self._placement(geom).moved(shape) for geom, shape in shapes.items()}
        points = np.concatenate([*standing.values(), np.zeros((0, 3))])
        obstacles = [standing[geom][shapes[geom].faces] for geom in shapes if self.solid[geom]]
        solid = np.concatenate([*obstacles, np.zeros((0, 3, 3))])
        upright, enclosed = ground_box(points[:, self._axes], solid[:, :, self._axes])
        box = upright[:, np.argsort(self._axes)]
        for geom in grounds:
            place = self._placement(geom)
            if geom in fields:
                cut = cut_height_field(fields[geom], place, box)
            else:
                half = np.asarray(self._model.geom_size[geom, :2], dtype=np.float64)
                around = enclosed and surrounds(half, float(place.rotation[self._axes[2], 2]), upright)
                cut = cut_plane(half, place, box, around)
            if cut is not None:
                shapes[geom] = cut
        for geom, shape in slabs.items():
            shapes[geom] = cut_slab(shape, self._placement(geom), box)

    def _check_number(self, geoms: list[int]) -> None:
        total = sum(num_triangles(self._model, geom) for geom in geoms)
        if total > MAX_TRIANGLES:
            raise SceneError(
                f"The geoms of the world have {total:.4g} triangles, but they end at {MAX_TRIANGLES}: make its meshes "
                "or its <quality numslices numstacks> coarser, or set ANM_MJ_MAX_TRIANGLES to allow more."
            )

    def _check_extent(self, geom: int, shape: Shape) -> None:
        if not np.abs(shape.vertices_m).max() + np.abs(self._data.geom_xpos[geom]).max() <= FARTHEST_M:
            raise SceneError(
                f"The geom {self._names(geom)[0]!r} is infinite, or reaches farther than {FARTHEST_M:g} m: repair its "
                "size or place."
            )

    def _placement(self, geom: int) -> Placement:
        return Placement(self._data.geom_xmat[geom].reshape(3, 3), self._data.geom_xpos[geom])

    def _names(self, geom: int) -> tuple[str, str]:
        """Names of a geom's submeshes and of its part; a geom of the world itself is a part of its own."""
        model = self._model
        own = model.geom(geom).name.replace("/", "_")
        mesh = int(model.geom_dataid[geom])
        if not own and model.geom_type[geom] == 7 and mesh >= 0:
            own = model.mesh(mesh).name.replace("/", "_")
        part = self.names[int(model.geom_bodyid[geom])]
        name = own or part.rpartition("/")[2] or f"geom{geom}"
        return name, part or own


def _report_left_out(
    model: mujoco.MjModel, names: list[str], robots: Bool[np.ndarray, " b"], report: ImportReport
) -> None:
    for body in np.flatnonzero(robots).tolist():
        if not robots[int(model.body_parentid[body])]:
            report.add(_ROBOT, names[body])
    sites = int(np.count_nonzero((model.site_group <= max(DRAWN_GROUPS)) & (model.site_rgba[:, 3] > 0.0)))
    counted = (
        (model.nu, "actuator", "actuators"),
        (model.ncam, "camera", "cameras"),
        (model.nlight, "light", "lights"),
        (sites, "marker (site)", "markers (site)"),
        (model.nflex, "deformable body", "deformable bodies"),
        (model.nskin, "skin", "skins"),
        (_drawn_tendons(model), "tendon", "tendons"),
    )
    for number, one, many in counted:
        if number:
            report.add(_OTHERS, f"{number} {one if number == 1 else many}")


def _drawn_tendons(model: mujoco.MjModel) -> int:
    """Number of the tendons that MuJoCo draws: those through places, not those that add up joints."""
    first = model.wrap_type[model.tendon_adr] if model.ntendon else np.zeros(0)
    seen = (model.tendon_group <= max(DRAWN_GROUPS)) & (model.tendon_rgba[:, 3] > 0.0)
    return int(np.count_nonzero(seen & (first != mujoco.mjtWrap.mjWRAP_JOINT)))
