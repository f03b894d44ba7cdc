"""Small motions of a camera, as displacement and rotation vector in the world."""

import math

import numpy as np
from jaxtyping import Float

_SMALL_RAD = 1e-8


def skew(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The matrix of the cross product with ``vector`` on the left."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_of(vector_rad: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation about ``vector_rad`` by its length (Rodrigues)."""
    # Of three numbers, numpy's calls would cost more than their sums.
    x, y, z = vector_rad.tolist()
    square = x * x + y * y + z * z
    if square < _SMALL_RAD**2:
        return np.eye(3) + skew(vector_rad)
    angle = math.sqrt(square)
    a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    return np.array(
        [
            [1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y],
            [b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x],
            [b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)],
        ]
    )


def rotation_vector(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """The rotation vector of a rotation by less than half a turn [rad]."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    x, y, z = 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)
    sine, length = np.array([x, y, z]), math.sqrt(x * x + y * y + z * z)
    angle = math.atan2(length, 0.5 * (xx + yy + zz - 1.0))
    if length > _SMALL_RAD:
        return sine * (angle / length)
    if angle < 1.0:
        return sine
    # Half a turn: the axis is the column of the largest diagonal entry.
    square = 0.5 * (rotation + np.eye(3))
    axis = square[:, int(np.argmax(np.diag(square)))]
    return angle * axis / math.sqrt(float(axis @ axis))


def moved_camera(T_world_camera: Float[np.ndarray, "4 4"], change: Float[np.ndarray, "6"]) -> Float[np.ndarray, "4 4"]:
    """The pose after a displacement [m] and a rotation vector about the camera [rad], both along world axes."""
    moved = np.eye(4)
    moved[:3, :3] = rotation_of(change[3:]) @ T_world_camera[:3, :3]
    moved[:3, 3] = T_world_camera[:3, 3] + change[:3]
    return moved


def camera_motion(
    T_world_from: Float[np.ndarray, "4 4"], T_world_to: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "6"]:
    """The change that :func:`moved_camera` needs to bring the first pose to the second."""
    turned = rotation_vector(T_world_to[:3, :3] @ T_world_from[:3, :3].T)
    return np.concatenate((T_world_to[:3, 3] - T_world_from[:3, 3], turned))


def transition(
    T_world_from: Float[np.ndarray, "4 4"], T_world_to: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "6 6"]:
    """What a small change of a pose makes of another one that is rigid to it: a rotation moves that one, too."""
    onward = np.eye(6)
    onward[:3, 3:] = -skew(T_world_to[:3, 3] - T_world_from[:3, 3])
    return onward


def carried(
    T_world_from: Float[np.ndarray, "4 4"], covariance: Float[np.ndarray, "6 6"], T_world_to: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "6 6"]:
    """Covariance of a pose that stands to another one as if both were rigid, from that one's."""
    onward = transition(T_world_from, T_world_to)
    return onward @ covariance @ onward.T
