"""Robots, and the small trained map of the mapping tests."""

from tests.mapping.conftest import room, tiny_config, trained_map
from tests.robots import compile_scene, description, kinematics

__all__ = ["compile_scene", "description", "kinematics", "room", "tiny_config", "trained_map"]
