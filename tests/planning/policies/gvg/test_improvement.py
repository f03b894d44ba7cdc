import numpy as np
import pytest

from anm_mj.planning.policies.gvg.improvement import FRAMES_PER_VIEW, WORTH_UNSEEN_M, ExpectedImprovement
from anm_mj.types import SurfaceErrors

HERE = np.zeros(2)
COUNTED = {"focal_px": 128.0, "voxel_m": 0.05}


def errors(xyz_m, error_m, num_observations, **thinned):
    n = len(xyz_m)
    return SurfaceErrors(
        np.array(xyz_m, np.float32),
        np.full(n, error_m, np.float32),
        np.full(n, num_observations, np.float32),
        0.27,
        **thinned,
    )


def improvement(*known):
    found = ExpectedImprovement()
    for values in known:
        found.update(values, HERE, 6.0, **COUNTED)
    return found


def share(found, xyz_m, distance_m):
    return float(found.share(np.array([xyz_m]), np.array([distance_m]))[0])


def test_nothing_is_expected_where_no_error_is_known():
    assert share(improvement(), (1.0, 0.0, 1.0), 1.0) == 0.0
    assert share(improvement(errors([(1.0, 0.0, 1.0)], 0.02, 10)), (3.0, 0.0, 1.0), 1.0) == 0.0


def test_the_share_is_the_error_that_a_view_averages_out():
    found = improvement(errors([(1.0, 0.0, 1.0)], 0.02, 40))
    added = FRAMES_PER_VIEW * (128.0 * 0.05 / 2.0) ** 2
    assert share(found, (1.0, 0.0, 1.0), 2.0) == pytest.approx(
        0.02 / WORTH_UNSEEN_M * (1.0 - (41.0 / (41.0 + added)) ** 0.27), rel=1e-5
    )


@pytest.mark.parametrize(("counted_focal_px", "stride"), [(64.0, 2), (50.0, 3), (128.0, 1), (300.0, 1)])
def test_a_view_adds_as_many_observations_as_are_counted(counted_focal_px, stride):
    found = improvement(errors([(1.0, 0.0, 1.0)], 0.02, 40, counted_focal_px=counted_focal_px))
    added = FRAMES_PER_VIEW * (128.0 / stride * 0.05 / 2.0) ** 2
    assert share(found, (1.0, 0.0, 1.0), 2.0) == pytest.approx(
        0.02 / WORTH_UNSEEN_M * (1.0 - (41.0 / (41.0 + added)) ** 0.27), rel=1e-5
    )


def test_near_views_of_rarely_seen_bad_surface_are_worth_most():
    def worth(error_m, count, distance_m):
        return share(improvement(errors([(1.0, 0.0, 1.0)], error_m, count)), (1.0, 0.0, 1.0), distance_m)

    assert worth(0.02, 10, 1.0) > worth(0.02, 10, 3.0)
    assert worth(0.02, 10, 1.0) > worth(0.02, 300, 1.0)
    assert worth(0.02, 10, 1.0) > worth(0.01, 10, 1.0)
    # Never more than surface that was not seen at all.
    assert worth(1.0, 0, 0.1) <= 1.0


def test_errors_nearby_are_replaced_and_far_ones_kept():
    found = ExpectedImprovement()
    found.update(errors([(1.0, 0.0, 1.0), (9.0, 0.0, 1.0)], 0.02, 10), HERE, 20.0, **COUNTED)
    before = share(found, (9.0, 0.0, 1.0), 1.0)
    found.update(errors([(2.0, 0.0, 1.0)], 0.04, 10), HERE, 6.0, **COUNTED)
    assert share(found, (1.0, 0.0, 1.0), 1.0) == 0.0
    assert share(found, (2.0, 0.0, 1.0), 1.0) > 0.0
    assert share(found, (9.0, 0.0, 1.0), 1.0) == before
