<<<<<<< HEAD
from tests.robots import compile_scene, description, kinematics  # noqa: F401
=======
"""The small trained map of the mapping tests."""

from tests.mapping.conftest import room, tiny_config, trained_map

__all__ = ["room", "tiny_config", "trained_map"]
>>>>>>> loc
