"""Nodes of the tests speak on this machine only, in a domain of their own process."""

import os
import time
from collections.abc import Callable, Iterator

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this Python or machine")

os.environ["ROS_LOCALHOST_ONLY"] = "1"
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)

from anm_mj.ros.node import Node


@pytest.fixture
def node() -> Iterator[Node]:
    with Node() as made:
        yield made


@pytest.fixture
def other() -> Iterator[Node]:
    with Node() as made:
        yield made


def wait_until(is_so: Callable[[], object], within_s: float = 10.0) -> None:
    """Wait for what another thread does; fails where it does not happen."""
    end = time.monotonic() + within_s
    while not is_so():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.01)
