"""What moved through the scene at a frame, as it is drawn: discs for people, vacuum robots, the chair; leaves."""

import numpy as np
from jaxtyping import Float

from anm_mj.io.run_records import FrameRecord
from anm_mj.people.crowd import CHAIR, VACUUM
from anm_mj.people.walking_floor import BODY

_PERSON_HEIGHT_M = 1.7


def discs(frame: FrameRecord) -> Float[np.ndarray, "p 4"]:
    """x, y, radius and height [m]: people, then vacuum robots, then the chair; as many in every frame of a run."""
    found = [(*state[:2], BODY.radius_m, _PERSON_HEIGHT_M) for state in frame.people]
    found += [(*state[:2], VACUUM.radius_m, VACUUM.z_max_m) for state in frame.vacuums]
    if frame.chair is not None:
        found.append((*frame.chair[:2], CHAIR.radius_m, CHAIR.z_max_m))
    return np.array(found, float).reshape(-1, 4)


def leaves(frame: FrameRecord) -> Float[np.ndarray, "d 4"]:
    """Of each leaf of a door: x and y of the hinge [m], yaw [rad], length [m]."""
    return np.array(frame.doors, float).reshape(-1, 4)


def leaf_ends(states: Float[np.ndarray, "d 4"]) -> Float[np.ndarray, "d 2 2"]:
    """Hinge and free end of each leaf [m]."""
    along = np.column_stack([np.cos(states[:, 2]), np.sin(states[:, 2])])
    return np.stack([states[:, :2], states[:, :2] + states[:, 3:] * along], axis=1)


def is_any(frame: FrameRecord) -> bool:
    """Whether anything moves in the run of a frame."""
    return bool(len(discs(frame)) or len(frame.doors))
