"""Poses in an SDF file: where every model, link and frame stands in the world (SDFormat 1.4 to 1.11).

A pose is given relative to a frame of the same scope: the model or world that it stands in, or what ``relative_to``
names. Gazebo classic's <state> gives poses in the world, which go before all others.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
from jaxtyping import Float64

from anm_mj.errors import SceneError

FRAMED = ("model", "link", "joint", "frame")
"""Elements that others may stand relative to."""
_OF_SCOPE = ("__model__", "world", "__root__")
"""Names of the frame of the model or world itself."""

Transform = Float64[np.ndarray, "4 4"]


def numbers(element: ET.Element | None, count: int, default: tuple[float, ...]) -> tuple[float, ...]:
    """The numbers in an element; ``default`` where there is none. Raises SceneError for text, or too few."""
    text = "" if element is None else (element.text or "").strip()
    if element is None or not text:
        return default
    try:
        values = tuple(float(word) for word in text.split())
    except ValueError:
        values = ()
    if len(values) < count or not all(math.isfinite(value) for value in values):
        raise SceneError(f"<{element.tag}>{text}</{element.tag}> should hold {count} numbers: fix the world file.")
    return values[:count]


def end_of_range(element: ET.Element | None) -> float:
    """The number in an element that ends a range: infinite where it has no end, NaN where there is no element. Raises
    SceneError for text.
    """
    text = "" if element is None else (element.text or "").strip()
    if text.lower().lstrip("+-") in ("inf", "infinity"):
        return float(text)
    return numbers(element, 1, (math.nan,))[0]


def text_of(element: ET.Element, path: str) -> str:
    """The text of the first such element within another; empty where there is none."""
    return (element.findtext(path) or "").strip()


def is_true(text: str | None) -> bool:
    """Whether a text stands for true; nothing does not."""
    return (text or "").strip().lower() in ("true", "1")


def pose_of(element: ET.Element) -> Transform:
    """The <pose> of an element as T_frame_element; where it states none, the identity.

    It is x y z and roll, pitch, yaw about fixed axes [rad, or degrees], or x y z and a quaternion x y z w. Raises
    SceneError if it states its rotation in another way, or holds no such numbers.
    """
    pose, matrix = element.find("pose"), np.eye(4)
    rotation_format = "euler_rpy" if pose is None else pose.get("rotation_format", "euler_rpy")
    if rotation_format not in ("euler_rpy", "quat_xyzw"):
        raise SceneError(f"A <pose> has the rotation_format {rotation_format!r}: write euler_rpy or quat_xyzw.")
    if pose is not None and rotation_format == "quat_xyzw":
        x, y, z, *xyzw = numbers(pose, 7, (0.0,) * 6 + (1.0,))
        matrix[:3, :3] = quaternion_matrix((xyzw[3], xyzw[0], xyzw[1], xyzw[2]))
    else:
        x, y, z, *rpy = numbers(pose, 6, (0.0,) * 6)
        if pose is not None and is_true(pose.get("degrees")):
            rpy = [math.radians(angle) for angle in rpy]
        matrix[:3, :3] = rpy_matrix(rpy[0], rpy[1], rpy[2])
    matrix[:3, 3] = x, y, z
    return matrix


def rpy_matrix(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Float64[np.ndarray, "3 3"]:
    """Rotation by roll, then pitch, then yaw about the fixed axes x, y, z."""
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll_rad, pitch_rad, yaw_rad]), np.cos([roll_rad, pitch_rad, yaw_rad])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def quaternion_matrix(wxyz: tuple[float, float, float, float]) -> Float64[np.ndarray, "3 3"]:
    """Rotation of a quaternion of any length but 0. Raises SceneError if it is 0 or not finite."""
    length = math.sqrt(sum(value * value for value in wxyz))
    if not (math.isfinite(length) and length > 1e-9):
        raise SceneError(f"The quaternion {wxyz} is no rotation: fix it in the source.")
    w, x, y, z = (value / length for value in wxyz)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


class Scope:
    """The frames of a model or of the world, by name, and where they stand in the world."""

    def __init__(self, element: ET.Element, T_world_scope: Transform, states: dict[str, Transform], path: str) -> None:
        """The scope of a <world> or <model>.

        ``states`` are poses in the world of models and links by path ("model::nested::link"), from <state>; ``path``
        is the element's own, empty for the world.
        """
        self.element = element
        self.T_world_scope = T_world_scope
        self.path = path
        self._states = states
        self._where = f"{element.tag} {element.get('name', '')!r}"
        self._framed = {child.get("name", ""): child for child in element if child.tag in FRAMED}
        self._poses: dict[str, Transform] = {}

    def place(self, child: ET.Element) -> Transform:
        """T_world_child of an element of this scope, named or not. Raises SceneError if its pose is relative to a frame
        that is not there, or to itself by a detour.
        """
        name = child.get("name", "")
        if child.tag in FRAMED and self._framed.get(name) is child:
            return self.frame(name)
        return self._place(child)

    def frame(self, name: str) -> Transform:
        """T_world_frame of a named frame of this scope; ``model::link`` reaches into a model; raises as ``place``."""
        if name in _OF_SCOPE:
            return self.T_world_scope
        first, _, rest = name.partition("::")
        self._place_chain(first)
        return self.inner(self._named(first)).frame(rest) if rest else self._poses[first]

    def place_on(self, child: ET.Element, T_world_parent: Transform) -> Transform:
        """T_world_child of an element on the frame its pose names or on its parent; raises as ``place``."""
        frame = relative_to(child)
        return (self.frame(frame) if frame else T_world_parent) @ pose_of(child)

    def moved(self, link: ET.Element, parent: str) -> Transform:
        """The motion in the world by which the saved state has a link of this scope elsewhere than its own pose says,
        as seen from the link ``parent``, or from the model where that has none of the name.
        """
        if not self._states:
            return np.eye(4)
        as_written = Scope(self.element, np.eye(4), {}, self.path)
        base = self._framed.get(parent)
        T_world_model = self.T_world_scope
        if base is not None:
            T_world_model = self.place(base) @ np.linalg.inv(as_written.place(base))
        return self.place(link) @ np.linalg.inv(T_world_model @ as_written.place(link))

    def _named(self, name: str) -> ET.Element:
        child = self._framed.get(name)
        if child is None:
            raise SceneError(
                f"A pose in {self._where} is relative to {name!r}, which is not there: fix the world file."
            )
        return child

    def _place_chain(self, name: str) -> None:
        """Place a named frame after all that it stands on, one by one: a chain may have thousands of frames."""
        chain: dict[str, ET.Element] = {}
        while name not in _OF_SCOPE and name not in self._poses:
            if name in chain:
                raise SceneError(f"The poses in {self._where} go round in a circle at {name!r}: fix the world file.")
            chain[name] = self._named(name)
            name = (self._stands_on(chain[name]) or _OF_SCOPE[0]).partition("::")[0]
        for each, child in reversed(chain.items()):
            self._poses[each] = self._place(child)

    def inner(self, model: ET.Element) -> Scope:
        """The scope of a model in this one."""
        T_world_model = self.place(model)
        path = self._state_path(model)
        inner = Scope(model, T_world_model, self._states, path)
        placed = model.get("placement_frame")
        if placed and path not in self._states:
            # The pose is that of the placement frame, and the model's own follows from it.
            T_model_placement = np.linalg.inv(T_world_model) @ inner.frame(placed)
            return Scope(model, T_world_model @ np.linalg.inv(T_model_placement), self._states, path)
        return inner

    def _place(self, child: ET.Element) -> Transform:
        """T_world_child from the state, or from the frame that its pose is relative to."""
        state = self._states.get(self._state_path(child))
        if state is not None and child.tag in ("model", "link"):
            return state
        frame = self._stands_on(child)
        return (self.frame(frame) if frame else self.T_world_scope) @ pose_of(child)

    def _state_path(self, child: ET.Element) -> str:
        return "::".join(part for part in (self.path, child.get("name", "")) if part)

    def _stands_on(self, child: ET.Element) -> str:
        """The frame that the pose of an element is relative to; empty where that is the scope's own, or the world's."""
        if child.tag in ("model", "link") and self._state_path(child) in self._states:
            return ""
        frame = relative_to(child)
        if not frame and child.tag == "frame":
            frame = child.get("attached_to")
        if not frame and child.tag == "joint":
            frame = text_of(child, "child")
        return frame or ""


def relative_to(element: ET.Element) -> str | None:
    """The frame that the pose of an element names; nothing where it names none."""
    pose = element.find("pose")
    return None if pose is None else pose.get("relative_to") or pose.get("frame")


def state_poses(world: ET.Element) -> dict[str, Transform]:
    """Poses in the world of models and links, by path, from the first <state> of a Gazebo classic world."""
    poses: dict[str, Transform] = {}

    def add(parent: ET.Element, path: str) -> None:
        for child in parent:
            if child.tag in ("model", "link"):
                inner = f"{path}::{child.get('name', '')}" if path else child.get("name", "")
                if child.find("pose") is not None:
                    poses[inner] = pose_of(child)
                add(child, inner)

    state = world.find("state")
    if state is not None:
        add(state, "")
    return poses
