import numpy as np
import pytest

from anm_mj.evaluation.oracle import tour_planner
from anm_mj.evaluation.oracle.roadmap import Roadmap
from anm_mj.evaluation.oracle.visibility import frame_bits
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.ground_truth.observable import ReachableArea, observable_samples
from anm_mj.ground_truth.pixel_rays import PixelRays
from anm_mj.utils.raycast import RayCaster
from tests.ground_truth.test_observable import CAMERA_ON_BASE, box, joined


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture(scope="session")
def known_bits():
    return {}


@pytest.fixture(autouse=True)
def bits_once(known_bits, monkeypatch):
    """What is seen from the places of the rooms is computed once for all planners; it takes most of a plan."""

    def bits(samples, places_m, rays):
        key = samples.tobytes(), places_m.tobytes()
        if key not in known_bits:
            known_bits[key] = frame_bits(samples, places_m, rays)
        return known_bits[key].copy()

    monkeypatch.setattr(tour_planner, "frame_bits", bits)


@pytest.fixture(scope="session")
def rooms():
    """Two rooms with a door between them, the area of both, and what can be seen there."""
    vertices, faces = joined(
        box((-3.0, -1.5, 0.0), (3.0, 1.5, 2.5)),
        box((-0.05, -1.5, 0.0), (0.05, 0.4, 2.5)),
        box((-2.6, -1.4, 0.0), (-2.0, -0.8, 0.8)),
    )
    reachable = np.zeros((30, 60), bool)
    reachable[3:27, 3:57] = True
    reachable[:22, 27:33] = False
    reachable[:10, 1:13] = False
    area = ReachableArea(reachable, np.array([-3.0, -1.5]), 0.1)
    truth = GroundTruth.sample(vertices, faces, 3_000)
    observable = observable_samples(truth.samples, RayCaster(vertices, faces), area, CAMERA_ON_BASE)
    return GroundTruth(truth.samples, truth.vertices, truth.faces, observable), area


@pytest.fixture(scope="session")
def views(rooms):
    """Ways between places, samples, and what is seen of them."""
    truth, area = rooms
    roadmap = Roadmap(area, 0.4)
    samples = truth.samples[truth.observable][:640]
    bits = frame_bits(samples, roadmap.places_m, PixelRays(RayCaster(truth.vertices, truth.faces), CAMERA_ON_BASE))
    return roadmap, samples, bits
