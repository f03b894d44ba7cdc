"""Reads Gazebo worlds (SDF): models, includes, meshes and simple shapes, as they look when the world is opened.

Lights, plug-ins, joints and physics are left out; what moves stands still. A ground plane, which is endless or a
hundred metres wide, is cut to what stands on it. The unit of a COLLADA mesh is applied and its up axis is not, as
Gazebo does.
"""

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation

from anm_mj.errors import SceneError
from anm_mj.scene.importing.canonical_axes import find_floor
from anm_mj.scene.importing.readers.import_limits import LimitError, TriangleBudget
from anm_mj.scene.importing.readers.import_report import LEFT_OUT, NO_MESH, NO_SHAPE, ImportReport
from anm_mj.scene.importing.readers.model_path import XACRO, Places, find_uri, model_file, world_places
from anm_mj.scene.importing.readers.parsed_scene import Joint, ParsedScene
from anm_mj.scene.importing.readers.read_mesh import PLAIN_RGB, read_mesh
from anm_mj.scene.importing.readers.sdf_include import FOLDER, part_path, read_world
from anm_mj.scene.importing.readers.sdf_material import Material, MaterialReader, with_material
from anm_mj.scene.importing.readers.sdf_pose import (
    Scope,
    Transform,
    end_of_range,
    is_true,
    numbers,
    state_poses,
    text_of,
)
from anm_mj.scene.importing.readers.sdf_shape import plane_submesh, shape_submesh
from anm_mj.scene.importing.readers.submesh_name import Nodes, named_submeshes, nodes_of
from anm_mj.scene.raster import areas, clip_to_slab, grid_over, level_mask, rasterise
from anm_mj.scene.submesh import Submesh, middle_of, transformed, triangles_of

_FAR_M = 1000.0
"""A saved world may hold objects that have fallen off it; nothing indoors is so far from the others [m]."""
_WIDE_M = 20.0
"""A level plane wider than this is the ground [m]."""
_COVERED = 0.5
_SUNK_M = 0.02
"""A ground plane is lowered by this where a floor of the world covers most of it: coplanar surfaces flicker [m]."""

_FALLEN = "Left out, because they lie more than 1 km away: {names}."
_GROUND = "No floor lies below what stands in {names}: the file's own z = 0 is taken for the ground."
_SCALED = "Not applied: the scale in the saved state of {names}."


def is_gazebo(src: Path) -> bool:
    """Whether a file is a Gazebo world or model, or a folder a Gazebo model."""
    if os.path.isdir(src):
        return os.path.isfile(src / "model.config") and model_file(src) is not None
    return src.name.lower().removesuffix(XACRO).endswith((".world", ".sdf"))


def read_gazebo(src: Path, model_paths: Sequence[Path], report: ImportReport) -> ParsedScene:
    """The first world of an SDF file, or its models if it has none. Raises SceneError if the file is no SDF, holds
    nothing that can be drawn, or poses that lead nowhere.
    """
    file = model_file(src)
    if file is None:
        raise SceneError(f"{src} is no Gazebo model: it holds neither model.config nor model.sdf.")
    places = world_places(file, model_paths)
    world, used = read_world(file, places, report)
    reader = _Reader(file, places, report)
    submeshes = reader.read(world)
    if not submeshes:
        why = " ".join(["check where its models are (--model-path).", *report.sentences()])
        raise SceneError(f"{file} holds nothing that can be drawn: {why}")
    models = ", ".join(sorted(used))
    source = f"Gazebo world {file.name}" + (f" with the models {models}" if models else "")
    return ParsedScene(submeshes, source, up="z", up_certainty=float("inf"), scale=1.0, joints=reader.joints)


class _Reader:
    def __init__(self, file: Path, places: Places, report: ImportReport) -> None:
        self.joints: dict[str, Joint] = {}
        """How links can move, by the name of their part."""
        self._deleted: set[str] = set()
        """Names of the world's models that its saved state has deleted."""
        self._middle_m = np.zeros(3)
        """Where the world's models stand."""
        self._name = file.name
        self._places = places
        self._report = report
        self._budget = TriangleBudget(file)
        self._materials = MaterialReader(places, report)
        self._meshes: dict[Path, list[Submesh]] = {}
        self._nodes: dict[Path, Nodes] = {}
        self._submeshes: list[Submesh] = []
        self._grounds: list[tuple[Submesh, Material]] = []

    def read(self, world: ET.Element) -> list[Submesh]:
        """Everything that can be drawn of a world whose includes are in place, in world coordinates [m]."""
        self._deleted = {(name.text or "").strip() for name in world.findall("state/deletions/name")}
        for scaled in world.findall("state//model"):
            scale = numbers(scaled.find("scale"), 3, (1.0, 1.0, 1.0))
            if scale != (1.0, 1.0, 1.0) and scaled.get("name") not in self._deleted:
                self._report.add(_SCALED, scaled.get("name", "a model"))
        # A file with a model instead of a world holds one part.
        scope = Scope(world, np.eye(4), state_poses(world), "")
        self._middle_m = self._middle_of_models(scope)
        self._read_scope(scope, "")
        if self._submeshes and not self._grounds and lacks_ground(triangles_of(self._submeshes)):
            self._report.add(_GROUND, self._name)
            ground = plane_submesh((2.0 * _FAR_M, 2.0 * _FAR_M), np.array([0.0, 0.0, 1.0]), "ground")
            ground = transformed(ground, np.eye(3), self._middle_m * (1.0, 1.0, 0.0))
            self._grounds.append((ground, Material(PLAIN_RGB)))
        return self._submeshes + [submesh for ground in self._grounds for submesh in self._cut_ground(*ground)]

    def _middle_of_models(self, scope: Scope) -> Float64[np.ndarray, "3"]:
        """The origin [m], or the median of where the world's models stand if more of them are near that: some worlds
        are in map coordinates, and in others most objects have fallen, each to another depth.
        """
        models = [child for child in scope.element.findall("model") if child.get("name") not in self._deleted]
        at_m = np.array([scope.inner(model).T_world_scope[:3, 3] for model in models]).reshape(-1, 3)
        if not len(at_m):
            return np.zeros(3)
        # One that is a model's coordinate, also between two groups of as many models.
        median_m = np.sort(at_m, axis=0)[(len(at_m) - 1) // 2]
        near_origin, near_median = (
            int(np.count_nonzero(np.abs(at_m - middle_m).max(axis=1) <= _FAR_M)) for middle_m in (np.zeros(3), median_m)
        )
        is_elsewhere = np.abs(median_m).max() > _FAR_M and near_median > near_origin
        return median_m if is_elsewhere else np.zeros(3)

    def _read_scope(self, scope: Scope, part: str) -> None:
        for child in scope.element:
            if child.tag == "model":
                # Poses may still be relative to it.
                if not part and child.get("name") in self._deleted:
                    continue
                inner = scope.inner(child)
                if np.abs(inner.T_world_scope[:3, 3] - self._middle_m).max() > _FAR_M:
                    self._report.add(_FALLEN, child.get("name", "a model"))
                else:
                    self._read_scope(inner, part_path(part, child, "model"))
            elif child.tag == "link":
                folder = Path(child.get(FOLDER) or scope.element.get(FOLDER, "."))
                for visual in child.findall("visual"):
                    self._read_visual(visual, scope, scope.place(child), folder, part_path(part, child, "link"))
            elif child.tag == "joint":
                self._read_joint(child, scope, part)
            elif child.tag in ("actor", "population", "road"):
                self._report.add(NO_SHAPE, f"<{child.tag}> {child.get('name', '')}".strip())

    def _read_visual(self, visual: ET.Element, scope: Scope, T_world_link: Transform, folder: Path, part: str) -> None:
        shapes = visual.findall("geometry/*")
        shape = shapes[0] if shapes else None
        if shape is None or shape.tag == "empty" or numbers(visual.find("transparency"), 1, (0.0,))[0] >= 1.0:
            return
        T_world_visual = scope.place_on(visual, T_world_link)
        material = self._materials.read(visual.find("material"), folder)
        name = f"{scope.element.get('name', 'model')}_{visual.get('name', 'visual')}"

        def stand(submesh: Submesh) -> Submesh:
            self._budget.spend(submesh)
            return replace(transformed(submesh, T_world_visual[:3, :3], T_world_visual[:3, 3]), part=part)

        if shape.tag == "mesh":
            for submesh in self._mesh_submeshes(shape, folder):
                self._submeshes.append(stand(submesh if material is None else with_material(submesh, material)))
            return
        material = Material(PLAIN_RGB) if material is None else material
        if shape.tag == "plane":
            width, depth = numbers(shape.find("size"), 2, (1.0, 1.0))
            normal = np.array(numbers(shape.find("normal"), 3, (0.0, 0.0, 1.0)))
            plane = stand(plane_submesh((width, depth), normal, name))
            if max(width, depth) > _WIDE_M and level_mask(plane.vertices_m[plane.faces]).all():
                self._grounds.append((plane, material))
            else:
                self._submeshes.append(with_material(plane, material))
            return
        submesh = shape_submesh(shape, name, [other for other in shapes[1:] if other.tag == "polyline"])
        if submesh is None:
            self._report.add(NO_SHAPE, f"<{shape.tag}> of {name}")
        else:
            self._submeshes.append(stand(with_material(submesh, material)))

    def _read_joint(self, joint: ET.Element, scope: Scope, part: str) -> None:
        child = text_of(joint, "child")
        link = next((link for link in scope.element.findall("link") if link.get("name") == child), None)
        axis = joint.find("axis")
        if joint.get("type") not in ("revolute", "prismatic", "continuous") or link is None or axis is None:
            return
        T_world_joint = scope.place_on(joint, scope.place(link))
        xyz = axis.find("xyz")
        direction = np.array(numbers(xyz, 3, (0.0, 0.0, 1.0)))
        expressed_in = None if xyz is None else xyz.get("expressed_in")
        in_model = is_true(axis.findtext("use_parent_model_frame"))
        T_world_axis = scope.frame(expressed_in) if expressed_in else scope.T_world_scope if in_model else T_world_joint
        low, high = (end_of_range(axis.find(f"limit/{end}")) for end in ("lower", "upper"))
        # Endless limits are written as infinite or huge numbers.
        limited = joint.get("type") != "continuous" and -1e3 < low <= high < 1e3
        length = float(np.linalg.norm(direction))
        if length > 0.0:
            hinge, along = joint.get("type") != "prismatic", T_world_axis[:3, :3] @ direction / length
            motion = scope.moved(link, text_of(joint, "parent"))
            turn_or_shift = Rotation.from_matrix(motion[:3, :3]).as_rotvec() if hinge else motion[:3, 3]
            self.joints[part_path(part, link, "link")] = Joint(
                hinge=hinge,
                axis=along,
                anchor_m=T_world_joint[:3, 3].copy(),
                # Saved poses have six digits.
                value=round(float(turn_or_shift @ along), 5) + 0.0,
                limits=(low, high) if limited else None,
            )

    def _mesh_submeshes(self, shape: ET.Element, folder: Path) -> Iterator[Submesh]:
        """The submeshes of a <mesh>, scaled; none, with a note, where they cannot be had."""
        uri = text_of(shape, "uri")
        path = find_uri(uri, folder, self._places, self._report)
        if path is None or not os.path.isfile(path):
            self._report.add(NO_MESH, uri.partition("://")[2] or uri)
            return
        if path not in self._meshes:
            try:
                self._meshes[path] = read_mesh(path, self._report)
            except LimitError:
                raise
            except SceneError as err:
                self._report.add(LEFT_OUT, f"{path.name} ({str(err).removeprefix(str(path)).strip()})")
                self._meshes[path] = []
        submeshes = self._meshes[path]
        wanted = text_of(shape, "submesh/name")
        if wanted:
            if path not in self._nodes:
                self._nodes[path] = nodes_of(path)
            submeshes = named_submeshes(self._nodes[path], submeshes, wanted)
            if not submeshes:
                self._report.add(NO_MESH, f"{wanted} in {path.name}")
        if submeshes and is_true(shape.findtext("submesh/center")):
            shift = -middle_of(submeshes)
            submeshes = [transformed(submesh, np.eye(3), shift) for submesh in submeshes]
        scale = np.diag(numbers(shape.find("scale"), 3, (1.0, 1.0, 1.0)))
        yield from (transformed(submesh, scale) for submesh in submeshes)

    def _cut_ground(self, ground: Submesh, material: Material) -> list[Submesh]:
        """A ground plane cut to what stands on it, and lowered a little under a floor of the world's own."""
        if not self._submeshes:
            return [with_material(ground, material)]
        triangles = triangles_of(self._submeshes)
        low, high = triangles.reshape(-1, 3).min(axis=0)[:2], triangles.reshape(-1, 3).max(axis=0)[:2]
        own = ground.vertices_m
        low, high = np.maximum(low, own[:, :2].min(axis=0)), np.minimum(high, own[:, :2].max(axis=0))
        if (high <= low).any():
            return []
        z_m = float(own[:, 2].mean())
        grid = grid_over(np.stack([low, high]), 0.1)
        floor = rasterise(clip_to_slab(triangles[level_mask(triangles)], z_m - _SUNK_M, z_m + _SUNK_M), grid)
        if floor.mean() > _COVERED:
            z_m -= _SUNK_M
        width, depth = (high - low).tolist()
        plane = plane_submesh((width, depth), np.array([0.0, 0.0, 1.0]), ground.name)
        plane = transformed(replace(plane, part=ground.part), np.eye(3), np.array([*(low + high) / 2.0, z_m]))
        # The texture keeps its size on the ground.
        share = (high - low) / np.maximum(np.ptp(own[:, :2], axis=0), 1e-9)
        return [with_material(replace(plane, uv=None if plane.uv is None else plane.uv * share), material)]


_ON_GROUND_M = 0.1
"""What reaches down to z = 0 within this stands on it [m]."""
_FLOOR_M = 0.2
"""A floor lower than this is one on the ground [m]; what is called floor above it may be the tops of walls."""


def lacks_ground(triangles_m: Float[np.ndarray, "f 3 3"]) -> bool:
    """Whether triangles with z up stand on z = 0 with no floor below them.

    That is so where their largest level surface lies above most of what is upright, as the tops of walls do.
    """
    z_m = triangles_m[:, :, 2]
    if abs(float(z_m.min())) > _ON_GROUND_M:
        return False
    floor = find_floor(triangles_m, roofs=True)
    if floor is None:
        return True
    if floor.z_m < _FLOOR_M:
        return False
    area, middle_m = np.where(level_mask(triangles_m), 0.0, areas(triangles_m)), z_m.mean(axis=1)
    return bool(area[middle_m < floor.z_m].sum() > area[middle_m > floor.z_m].sum())
