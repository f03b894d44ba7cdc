"""Where people walk in the tests."""

import pytest

from anm_mj.people.walking_floor import WalkingFloor
from anm_mj.scene.folder import load_scene


@pytest.fixture(scope="module")
def scene():
    return load_scene("home")


@pytest.fixture(scope="module")
def floor(scene):
    return WalkingFloor(scene)
