"""Describes a robot from a file of any kind: an MJCF, a URDF with the meshes that ROS finds, or one with macros."""

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np

from anm_mj.errors import RobotError, SceneError
from anm_mj.mjcf.read_mjcf import MAX_ROBOT_ELEMENTS, quiet_mujoco, root_tag
from anm_mj.robot.description import RobotDescription, describe_robot, spec_hash
from anm_mj.robot.robot_config import CameraConfig, RobotConfig
from anm_mj.robot.robot_presets import FOLDERS_VARIABLE, robot_folders
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.model_path import XACRO, expanded, find_uri, world_places
from anm_mj.scene.submesh import merge_geometry
from anm_mj.utils.read_file import read_bytes


def describe_file(
    path: Path, config: RobotConfig | None = None, camera: CameraConfig | None = None, image_px: int = 256
) -> RobotDescription:
    """The robot of an MJCF or URDF file; see :func:`~anm_mj.robot.description.describe_robot`.

    A URDF's meshes are found as ROS and Gazebo find them and may be of any format that scenes take. Of each its convex
    hull is kept, all that MuJoCo collides with; the speeds of its wheels end at the limits of their joints. Raises
    RobotError as ``describe_robot``, or if macros cannot be expanded, or a mesh is nowhere or cannot be read.
    """
    given, most_radps = _urdf(path) if _is_urdf(path) else (None, None)
    return describe_robot(path, config, camera, image_px, given=given, most_radps=most_radps)


def file_hash(path: Path) -> str:
    """What tells a robot's file, with its meshes, from other files. Raises RobotError as :func:`describe_file` if it
    cannot be read.
    """
    given, most_radps = _urdf(path) if _is_urdf(path) else (None, None)
    return spec_hash(path, given=given, most_radps=most_radps)


def _is_urdf(path: Path) -> bool:
    return path.suffix.lower() == XACRO or root_tag(path) == "robot"


def _urdf(path: Path) -> tuple[mujoco.MjSpec, dict[str, float]]:
    """A URDF as MuJoCo reads it, its meshes in it, and the highest speeds of its joints, which MuJoCo does not read, by
    name [rad/s].
    """
    try:
        content = expanded(path) if path.suffix.lower() == XACRO else read_bytes(path)
        robot = ET.fromstring(content.lstrip())
        if sum(1 for _ in robot.iter()) > MAX_ROBOT_ELEMENTS:
            raise ValueError(f"it has more than {MAX_ROBOT_ELEMENTS} elements; set ANM_MJ_MAX_ELEMENTS to allow more")
        hulls, most_radps = _take_meshes(robot, path), _speed_limits(robot)
        with quiet_mujoco():
            spec = mujoco.MjSpec.from_string(ET.tostring(robot, encoding="unicode"))
    except SceneError as err:
        raise RobotError(str(err)) from err
    except Exception as err:  # MuJoCo has errors of its own.
        raise RobotError(f"The robot {path} cannot be read ({err}): give an MJCF or URDF file with one robot.") from err
    for mesh in spec.meshes:
        vertices, faces = hulls[mesh.file]
        mesh.uservert, mesh.userface, mesh.file = vertices.ravel(), faces.ravel(), ""
    return spec, most_radps


def _speed_limits(robot: ET.Element) -> dict[str, float]:
    """The velocities in the limits of hinges, by name; exporters write 0 where nobody knows [rad/s]."""
    found = {}
    for joint in robot.findall("joint"):
        limit = joint.find("limit") if joint.get("type") in ("continuous", "revolute") else None
        text = "" if limit is None else limit.get("velocity", "")
        try:
            found[joint.get("name", "")] = float(text or 0.0)
        except ValueError:
            raise ValueError(f"the velocity {text!r} of its joint {joint.get('name')!r} is no number") from None
    return {name: value for name, value in found.items() if value > 0.0 and math.isfinite(value)}


def _take_meshes(robot: ET.Element, path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Give every mesh a plain name, and the vertices and faces of its convex hull by that name."""
    compiler, folder = robot.find("mujoco/compiler"), path.absolute().parent
    below = "" if compiler is None else compiler.attrib.pop("meshdir", "")
    if compiler is None or compiler.get("discardvisual") != "false":
        for link in robot.findall("link"):
            for visual in link.findall("visual"):
                link.remove(visual)
    places, report = world_places(path, robot_folders()), ImportReport()
    names: dict[tuple[Path, str], str] = {}
    hulls = {}
    for shape in robot.findall("link/*/geometry/mesh"):
        uri = shape.get("filename", "")
        # MuJoCo's own <compiler meshdir> in a URDF is where all meshes lie.
        alike = [uri] if not below else [f"{below}/{uri}", f"{below}/{uri.rpartition('/')[2]}", uri]
        found = next((file for each in alike if (file := find_uri(each, folder, places, report)) is not None), None)
        if found is None:
            raise SceneError(
                f"The robot {path} names the mesh {uri!r}, which is not found in its package or up to three folders "
                f"above it: give the folder that holds it by {FOLDERS_VARIABLE}."
            )
        key = (found, shape.get("scale", ""))
        if key not in names:
            names[key] = f"{found.stem}_{len(names)}.stl"
            hulls[names[key]] = _hull(found, report)
        shape.set("filename", names[key])
    report.log()
    return hulls


def _hull(file: Path, report: ImportReport) -> tuple[np.ndarray, np.ndarray]:
    import trimesh

    # Of the robots, only a URDF has meshes of formats that these libraries read.
    from anm_mj.scene.importing.readers.read_mesh import read_mesh

    vertices, faces = merge_geometry(read_mesh(file, report))
    try:
        hull = trimesh.Trimesh(vertices, faces, process=False).convex_hull
    except Exception as err:  # Qhull's errors.
        raise SceneError(f"The mesh {file} has no volume: give a collision mesh that encloses one.") from err
    return np.asarray(hull.vertices, float), np.asarray(hull.faces, np.int32)
