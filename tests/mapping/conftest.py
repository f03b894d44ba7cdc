"""A small map, trained once on views from the middle of the room."""

from dataclasses import replace

import pytest
import torch

from anm_mj.mapping.mapping_config import MappingConfig, quick_mapping
from anm_mj.mapping.neural_map import NeuralMap
from tests.mapping.ray_room import Room


@pytest.fixture(autouse=True, scope="session")
def _one_thread() -> None:
    """The arrays here are small: more threads would only wait for each other."""
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def tiny_config() -> MappingConfig:
    """The quick preset, cut down to a table and batches that train in a second or two."""
    quick = quick_mapping()
    return replace(
        quick,
        field=replace(quick.field, log2_table_size=13),
        schedule=replace(quick.schedule, first_iterations=60, iterations=16, num_rays=256, keyframe_every=1),
    )


@pytest.fixture(scope="session")
def room() -> Room:
    return Room()


@pytest.fixture(scope="session")
def trained_map(tiny_config: MappingConfig, room: Room) -> NeuralMap:
    """Treat as read-only: it is shared by all tests."""
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    for observation in room.turn(1.5, 1.5, 12, size=128):
        neural_map.integrate(observation)
    return neural_map
