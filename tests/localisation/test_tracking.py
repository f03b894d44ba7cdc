"""The verdict on a frame, by what the map says of it."""

from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.localisation.map_probe import Agreement, MapProbe
from anm_mj.localisation.registration import FREE, Prior, Registration
from anm_mj.localisation.tracking import Verdict, judged
from anm_mj.mapping.alignment import FramePoints

PRIOR = Prior(np.eye(4), np.eye(6) * 1e-4, FREE)


def verdict(num_confirmed: int, num_contradicted: int, known: float, least_known_score: float) -> Verdict:
    """On a frame of 100 points, whose known ones fit the field."""
    confirmed, contradicted = np.arange(100) < num_confirmed, np.arange(100) >= 100 - num_contradicted
    probe = Mock(spec=MapProbe)
    probe.agreement.return_value = Agreement(confirmed, contradicted)
    found = Mock(spec=Registration, T_world_camera=np.eye(4), known=known, inliers=1.0, colors=1.0, prior_cost=0.0)
    return judged(Mock(spec=FramePoints), PRIOR, found, probe, LocalisationConfig(), 0.0, least_known_score)[0]


@pytest.mark.parametrize(
    ("num_confirmed", "num_contradicted", "known", "least_known_score", "expected"),
    [
        (0, 0, 0.0, 0.5, Verdict.UNKNOWN),
        (4, 2, 0.05, 0.9, Verdict.UNKNOWN),
        (15, 0, 0.15, 0.9, Verdict.FITS),
        (75, 25, 1.0, 0.7, Verdict.FITS),
        (75, 25, 1.0, 0.8, Verdict.CONTRADICTS),
        (60, 40, 1.0, 0.0, Verdict.CONTRADICTS),
    ],
)
def test_a_frame_is_held_against_what_the_map_knows_of_it(
    num_confirmed: int, num_contradicted: int, known: float, least_known_score: float, expected: Verdict
) -> None:
    assert verdict(num_confirmed, num_contradicted, known, least_known_score) is expected
